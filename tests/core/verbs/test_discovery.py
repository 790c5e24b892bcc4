"""Verbs are found where packages offer them: ours, other people's, and broken ones that spoil nothing."""

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ltvn_core.errors import PluginError
from ltvn_core.plugins import OWN_PACKAGE, VERBS, Plugin
from ltvn_core.verbs.discovery import FIRST_SHOWN, GROUPS, find_verbs, load_verb
from tests.core.plugin_packages import install, ltvn

HEAVY = ("torch", "rerun", "pybullet", "viser", "numpy", "cv2", "matplotlib", "ltvn_viz.app")

GREETING = '''
from dataclasses import dataclass
from ltvn_core.verbs.verb import Verb

@dataclass(frozen=True)
class GreetingSummary:
    said: str

@dataclass(frozen=True, kw_only=True)
class GreetVerb(Verb):
    """Greet somebody."""

    name: str = "robot"

    def run(self) -> GreetingSummary:
        return GreetingSummary("hello " + self.name)
'''


def verb(entry: str) -> str:
    """Return the entry points of a package that offers one verb."""
    return f"[{VERBS.name}]\n{entry}\n"


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """A folder of three installed packages: a verb, a verb with the name of ours, and one that cannot be imported."""
    install(tmp_path, "greetings", verb("greet = greetings:GreetVerb"), source=GREETING)
    not_ours = GREETING.replace("Greet somebody", "Not ours")
    install(tmp_path, "another-info", verb("info = another_info:GreetVerb"), source=not_ours)
    install(tmp_path, "rusty", verb("oil = rusty:OilVerb"), source="import no_such_library")
    return tmp_path


def test_our_verbs_are_all_offered_in_the_order_of_a_first_time_user() -> None:
    ours = [name for name, plugin in find_verbs().items() if plugin.package == OWN_PACKAGE]
    assert tuple(ours) == FIRST_SHOWN


def test_the_verb_of_another_package_runs_like_ours(packages: Path) -> None:
    run = ltvn(packages, "greet", "--name", "Ada")
    assert (run.returncode, run.stdout.strip()) == (0, "said  hello Ada")
    assert '"said": "hello robot"' in ltvn(packages, "greet", "--json", "-").stdout


def test_the_help_has_every_verb_of_ours_once_below_its_heading_and_those_of_others_afterwards(packages: Path) -> None:
    help_text = ltvn(packages, "--help").stdout
    shown = help_text.splitlines()
    rows = [line.split()[0] for line in shown if line.startswith("  ") and line[2] != " "]
    assert [name for name in rows if name in FIRST_SHOWN] == list(FIRST_SHOWN)
    assert [line[:-1] for line in shown if line.endswith(":") and line[0] != " "] == [*GROUPS, "From other packages"]
    assert "Greet somebody" in help_text
    assert rows.index("export") < rows.index("greet")
    assert "Not ours" not in help_text
    assert "Describe recordings or maps" in ltvn(packages, "info", "--help").stdout


def test_ltvn_alone_says_with_what_to_begin(packages: Path) -> None:
    run = ltvn(packages)
    assert run.returncode == 0
    begun = re.findall(r"^  ltvn ([a-z]+)", run.stdout, re.MULTILINE)
    assert len(begun) == 4
    assert set(begun) <= set(FIRST_SHOWN)


def test_a_broken_package_is_named_in_one_line_and_spoils_no_other_verb(packages: Path) -> None:
    shown = ltvn(packages, "--help")
    assert shown.returncode == 0
    assert "  info " in shown.stdout
    (line,) = shown.stderr.strip().splitlines()
    assert line.startswith("ltvn: The verb oil of the package rusty cannot be loaded")
    assert "no_such_library" in line
    assert ltvn(packages, "greet").stderr == ""
    chosen = ltvn(packages, "oil")
    assert (chosen.returncode, chosen.stderr.strip()) == (1, line)


def test_what_is_no_verb_is_refused() -> None:
    with pytest.raises(PluginError, match="no subclass"):
        load_verb(Plugin(VERBS, EntryPoint("path", "pathlib:Path", VERBS.name)))


def test_help_needs_no_heavy_library() -> None:
    program = (
        "import sys\nfrom ltvn_core.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert run.stderr.strip() == "[]"


def test_ctrl_c_while_a_verb_is_imported_ends_with_one_line(tmp_path: Path) -> None:
    install(tmp_path, "slow", verb("slow = slow:SlowVerb"), source="raise KeyboardInterrupt")
    run = ltvn(tmp_path, "slow")
    assert (run.returncode, run.stderr) == (130, "ltvn: interrupted\n")


SOURCE = '''
from dataclasses import dataclass
from ltvn_core.verbs.verb import Verb

@dataclass(frozen=True)
class Dictionary(Verb):
    """Return a dictionary."""
    def run(self): return {"said": "hello"}

@dataclass(frozen=True)
class Nothing(Verb):
    """Return nothing."""
    def run(self): return None

@dataclass(frozen=True)
class Failing(Verb):
    """Fail."""
    def run(self): return {}["no such key"]

@dataclass(frozen=True)
class Bag:
    held: object

@dataclass(frozen=True)
class Unjsonable(Verb):
    """Return what JSON cannot hold."""
    def run(self): return Bag({1, 2})

@dataclass(frozen=True)
class Unreadable(Verb):
    """Have an option that no command line can have."""
    strange: 'NoSuchType' = None
    def run(self): return None

class Jobless(Verb):
    """Have nothing to do."""
'''


@pytest.fixture(scope="module")
def odd_packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("odd_packages")
    names = ("Dictionary", "Nothing", "Failing", "Unjsonable", "Unreadable", "Jobless")
    entries = "\n".join(f"{name.lower()} = odd_verbs:{name}" for name in names)
    install(folder, "odd-verbs", f"[{VERBS.name}]\n{entries}\n", source=SOURCE)
    return folder


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("dictionary", "a verb returns an object of a dataclass"),
        ("nothing", "a verb returns an object of a dataclass"),
        ("failing", "KeyError: 'no such key'"),
        ("unreadable", "odd-verbs"),
        ("jobless", "neither `job"),
    ],
)
def test_a_verb_that_cannot_do_its_work_is_named_in_one_line(odd_packages: Path, name: str, said: str) -> None:
    run = ltvn(odd_packages, name)

    assert run.returncode == 1
    (line,) = run.stderr.strip().splitlines()
    assert said in line
    assert "odd" in line


def test_debug_shows_where_a_verb_failed(odd_packages: Path) -> None:
    assert "in run" in ltvn(odd_packages, "failing", "--debug").stderr


def test_a_result_that_json_cannot_hold_is_told(odd_packages: Path) -> None:
    run = ltvn(odd_packages, "unjsonable", "--json", "-")
    assert run.returncode == 1
    assert "JSON" in run.stderr.strip().splitlines()[-1]
    assert "Traceback" not in run.stderr


def test_a_verb_whose_options_cannot_be_read_spoils_no_completion(odd_packages: Path) -> None:
    completed = ltvn(odd_packages, "--tyro-print-completion", "bash")

    assert completed.returncode == 0
    assert "replay" in completed.stdout
    assert "--every-m" in completed.stdout
