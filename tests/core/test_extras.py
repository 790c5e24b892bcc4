"""A plain installation records, replays in the page and analyses; what needs more says what to install."""

import json
import platform
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from ltvn_core.errors import MissingLibraryError
from ltvn_core.extras import EXTRAS, naming_the_extra, require_libraries

ROOT = Path(__file__).parents[2]

WITHOUT_EXTRAS = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {libraries}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Refuse())
"""

PLAIN_JOBS = """
import importlib, pkgutil
import ltvn_core.analysis, ltvn_core.graph, ltvn_core.navigation, ltvn_core.data.recording
for package in (ltvn_core.analysis, ltvn_core.graph, ltvn_core.navigation, ltvn_core.data.recording):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
recording = Recording.open("recordings/demo-fault.rrd")
assert len(Timeline.of(recording.events).queries) == 4
assert len(load_map("recordings/demo-map.rrd").graph.nodes) == 327
"""


PAGE = """
from ltvn_viz.app import AppOptions, open_app
from ltvn_viz.session.activities.playback import Playback
with open_app(AppOptions(replay="demo-fault.rrd", port=0)) as app:
    app.session.tick()
    app.session.state.worker.settle()
    app.session.tick()
    assert isinstance(app.session.state.activity, Playback)
"""

NEXT = "(next)"
REFUSED = f"""
import json
from ltvn_core.cli import main
for number, arguments in enumerate(json.loads(sys.argv[1])):
    print({NEXT!r} if number else "", file=sys.stderr)
    assert main(arguments) == 1
"""
NEEDY = (
    (("build", "recordings/demo-drive.rrd", "--output", "never.rrd"), "network"),
    (("app", "--port", "0"), "network,sim"),
    (("collect", "--scene", "demo", "--output", "never.rrd"), "sim"),
)


def _python(code: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    program = WITHOUT_EXTRAS.format(libraries=sorted(EXTRAS)) + code
    return subprocess.run([sys.executable, "-c", program, *arguments], cwd=ROOT, capture_output=True, text=True)


def test_recordings_maps_analysis_and_the_page_s_replay_need_no_extra() -> None:
    done = _python(PLAIN_JOBS + PAGE)

    assert done.returncode == 0, done.stderr


def test_a_verb_that_needs_an_extra_names_it() -> None:
    done = _python(REFUSED, json.dumps([arguments for arguments, _ in NEEDY]))

    told = done.stderr.split(NEXT)
    for (arguments, extra), said in zip(NEEDY, told, strict=True):
        assert f"pip install 'ltvn[{extra}]'" in said, arguments
        assert "Traceback" not in said
    assert not (ROOT / "never.rrd").exists()


def test_a_module_of_no_extra_is_reported_as_it_is() -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_library"), naming_the_extra():
        import no_such_library  # pyright: ignore[reportMissingImports]  # noqa: F401


def test_the_extras_that_errors_name_exist() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for library, extra in EXTRAS.items():
        assert any(library in each.replace("-", "_").split(">=")[0].split("==")[0] for each in declared[extra])


def test_a_missing_library_is_an_error_of_the_toolkit() -> None:
    with pytest.raises(MissingLibraryError, match=r"ltvn\[network\]"), naming_the_extra():
        raise ModuleNotFoundError("No module named 'torch'", name="torch")


def test_all_missing_libraries_are_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ltvn_core.extras.find_spec", lambda name: None if name in ("torch", "embreex") else name)

    require_libraries("viser", "joblib")
    with pytest.raises(MissingLibraryError, match=r"embreex and torch.*'ltvn\[network,sim\]'"):
        require_libraries("embreex", "joblib", "torch")


@pytest.fixture
def without_embree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of what the simulator needs is installed."""
    missing = ("embreex", "joblib", "torch")
    monkeypatch.setattr("ltvn_core.extras.find_spec", lambda name: None if name in missing else name)


@pytest.mark.parametrize("machine", ["aarch64", "ARM64"])
@pytest.mark.usefixtures("without_embree")
def test_where_embree_has_no_wheel_the_message_says_what_works(machine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)

    with pytest.raises(MissingLibraryError, match="ltvn replay") as refused:
        require_libraries("embreex", "torch")
    with pytest.raises(MissingLibraryError, match="ltvn replay") as unimportable, naming_the_extra():
        raise ModuleNotFoundError("No module named 'embreex.mesh'", name="embreex.mesh")

    assert str(refused.value) == str(unimportable.value)
    assert "pip install" not in str(refused.value)
    with pytest.raises(MissingLibraryError, match=r"ltvn\[network,sim\]"):
        require_libraries("joblib", "torch")


@pytest.mark.parametrize("machine", ["x86_64", "AMD64", "arm64", "aarch64", "ARM64"])
@pytest.mark.usefixtures("without_embree")
def test_embree_is_to_be_installed_exactly_where_the_extra_installs_it(
    machine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    embree = next(each for each in map(Requirement, declared["sim"]) if each.name == "embreex")
    assert embree.marker is not None

    with pytest.raises(MissingLibraryError) as refused:
        require_libraries("embreex")

    assert ("pip install" in str(refused.value)) == embree.marker.evaluate({"platform_machine": machine})
