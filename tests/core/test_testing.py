"""The contract test of a plug-in passes what can be used, and names what cannot."""

import json
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core import Prediction, PredictorRequest
from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.plugins import PREDICTORS, QUESTIONS, READERS, ROBOTS, SYSTEMS, Plugin, PluginGroup, find_plugins
from ltvn_core.testing import check_reader, check_robot
from ltvn_core.verbs.plugins import PluginsVerb, broken_contract, plugin_row
from tests.core.data.importing.drives import EXCERPT, ListedDrive
from tests.core.plugin_packages import install, ltvn
from tests.repository import ROOT

HERE = __name__
TEMPLATE = ROOT / "examples" / "plugin_template"


class SteadyPredictor:
    """Says the same of every pair, and can be told to break one rule."""

    fingerprint = "steady"

    def __init__(self, request: PredictorRequest, r: float = 0.6, *, noise: float = 0.0, width: int = 2) -> None:
        self.camera = request.camera
        self._r, self._width = r, width
        self._rng = np.random.default_rng(0) if noise else None

    def encode(self, observations: list) -> np.ndarray:
        return np.ones((len(observations), self._width))

    def predict(self, sources: np.ndarray, targets: np.ndarray) -> Prediction:
        r = np.full(len(targets), self._r)
        if self._rng is not None:
            r = r - 0.1 * self._rng.random(len(targets))
        return Prediction(r, np.zeros((len(targets), 3)))


def steady(request: PredictorRequest) -> SteadyPredictor:
    return SteadyPredictor(request)


def restless(request: PredictorRequest) -> SteadyPredictor:
    return SteadyPredictor(request, noise=1.0)


def boastful(request: PredictorRequest) -> SteadyPredictor:
    return SteadyPredictor(request, r=1.4)


def undecided(request: PredictorRequest) -> SteadyPredictor:
    return SteadyPredictor(request, r=float("nan"))


def forgetful(request: PredictorRequest) -> SteadyPredictor:
    return SteadyPredictor(request, r=0.1)


def broken(request: PredictorRequest) -> SteadyPredictor:
    raise OSError("no weights")


def a_robot() -> Any:
    from tests.core.flat_world import FlatRobot, one_room

    return FlatRobot(one_room(), (1.0, 1.0, 0.0))


class GreedyReader:
    """Wants everything."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        return True

    @classmethod
    def open(cls, path: Path, options: object) -> None: ...


def plugin(group: PluginGroup, name: str) -> Plugin:
    return Plugin(group, EntryPoint(name, f"{HERE}:{name}", group.name))


def test_a_sound_predictor_keeps_the_contract() -> None:
    assert broken_contract(plugin(PREDICTORS, "steady")) == ""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("restless", "differs"),
        ("boastful", "r must lie in [0, 1]"),
        ("undecided", "must be finite"),
        ("forgetful", "r of at least 0.5"),
        ("broken", "OSError: no weights"),
    ],
)
def test_a_predictor_that_breaks_a_rule_is_told_which(name: str, said: str) -> None:
    assert said in broken_contract(plugin(PREDICTORS, name))


def test_our_geometric_predictor_keeps_the_contract() -> None:
    assert broken_contract(find_plugins(PREDICTORS)["geometric"]) == ""


@pytest.mark.parametrize("name", ["ltvn", "sptm", "ving"])
def test_our_navigation_systems_keep_the_contract(name: str) -> None:
    assert broken_contract(find_plugins(SYSTEMS)[name]) == ""


def test_our_readers_recognise_nothing_in_noise() -> None:
    for reader in find_plugins(READERS).values():
        assert broken_contract(reader) == ""
    assert "recognise noise" in broken_contract(plugin(READERS, "GreedyReader"))


def test_a_reader_is_tested_with_a_drive(tmp_path: Path) -> None:
    reader = find_plugins(READERS)["tum"]
    assert broken_contract(reader, drive=EXCERPT) == ""
    assert "does not recognise" in broken_contract(reader, drive=tmp_path)


class ForgetfulReader:
    """Names odometry, and yields none."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        return path == EXCERPT

    @classmethod
    def open(cls, path: Path, options: object) -> ListedDrive:
        frames = find_plugins(READERS)["tum"].load().open(path, ReadOptions()).frames()  # type: ignore[attr-defined]
        return ListedDrive(frames, ("rgb", "odometry"))


def test_a_reader_whose_frames_lack_what_its_facts_name_is_broken() -> None:
    with pytest.raises(AssertionError, match="no frame has odometry"):
        check_reader(ForgetfulReader, EXCERPT)


def test_a_robot_is_looked_at_and_not_driven() -> None:
    assert broken_contract(plugin(ROBOTS, "a_robot")) == ""


def test_a_robot_whose_step_stands_still_is_broken() -> None:
    def stuck() -> object:
        robot = a_robot()
        state = robot.state
        robot.state = lambda: state()._replace(step=0)
        return robot

    with pytest.raises(AssertionError, match="step of state"):
        check_robot(stuck)


def test_all_that_comes_with_the_toolkit_is_listed_and_can_be_loaded() -> None:
    listed: Any = PluginsVerb().run()
    rows = listed.plugins
    assert {"ltvn.verbs", "ltvn.predictors", "ltvn.systems"} <= {row.group for row in rows}
    assert [str(row) for row in rows if row.package == "ltvn" and not row.works] == []


def test_questions_are_asked_about_the_demo_recording() -> None:
    here = "tests.viz.debugger.test_foreign_questions"
    broken = {
        name: broken_contract(Plugin(QUESTIONS, EntryPoint(name, f"{here}:{name}", QUESTIONS.name)))
        for name in ("Sound", "Wordless", "Dividing")
    }
    assert broken["Sound"] == ""
    assert broken["Wordless"]
    assert "ZeroDivisionError: one by none" in broken["Dividing"]


def test_a_verb_whose_job_is_missing_is_broken(tmp_path: Path) -> None:
    source = (
        "from ltvn_core.verbs.verb import Verb\n"
        'class Idle(Verb):\n    """Rest."""\n    job = "ltvn_core.verbs.plugins:rest"\n'
    )
    install(tmp_path, "idle", "[ltvn.verbs]\nidle = idle:Idle\n", source=source)
    tested = ltvn(tmp_path, "plugins", "test", "idle")
    assert (tested.returncode, "plugins:rest is no function" in tested.stdout) == (1, True)


def test_a_name_that_another_package_has_already_is_listed_with_it(tmp_path: Path) -> None:
    install(tmp_path, "another-info", "[ltvn.verbs]\ninfo = another_info:Verb\n")
    listed = ltvn(tmp_path, "plugins", "--group", "ltvn.verbs").stdout
    (line,) = (line for line in listed.splitlines() if "another-info" in line)
    assert "cannot be used: the package ltvn" in line


def test_a_plug_in_that_cannot_be_loaded_is_listed_with_the_reason() -> None:
    row = plugin_row(plugin(PREDICTORS, "gone"))
    assert (row.works, "has no attribute 'gone'" in row.why) == (False, True)


def test_the_template_package_is_found_and_passes_its_test(tmp_path: Path) -> None:
    entry_points = (
        (TEMPLATE / "pyproject.toml").read_text(encoding="utf-8").split("[project.entry-points.")[1].split("\n[")[0]
    )
    listed = entry_points.replace('"', "").replace("ltvn.predictors]", "[ltvn.predictors]")
    source = (TEMPLATE / "thumbnail_predictor.py").read_text(encoding="utf-8")
    install(tmp_path, "thumbnail_predictor", listed, source=source)

    tested = ltvn(tmp_path, "plugins", "test", "thumbnails", "--json", "-")

    summary = json.loads(tested.stdout)
    assert (tested.returncode, summary["package"], summary["why"]) == (0, "thumbnail_predictor", "")
    assert "thumbnails" in ltvn(tmp_path, "build", "--help").stdout


def test_the_exit_code_of_a_broken_plug_in_is_not_zero(tmp_path: Path) -> None:
    install(tmp_path, "torn", "[ltvn.predictors]\ntorn = torn:make\n", source="make = 3")
    tested = ltvn(tmp_path, "plugins", "test", "torn")
    assert tested.returncode == 1
    assert "The predictor torn of the package torn is torn:make" in tested.stdout
    listed = ltvn(tmp_path, "plugins", "--group", "ltvn.predictors")
    assert (listed.returncode, "torn 1.0  cannot be used: " in listed.stdout) == (0, True)
