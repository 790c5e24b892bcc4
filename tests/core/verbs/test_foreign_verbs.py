"""A verb of another package that fails or returns what it must not ends with one line that names it."""

from pathlib import Path

import pytest

from ltvn_core.plugins import VERBS
from tests.core.plugin_packages import install, ltvn

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
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
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
def test_a_verb_that_cannot_do_its_work_is_named_in_one_line(packages: Path, name: str, said: str) -> None:
    run = ltvn(packages, name)

    assert run.returncode == 1
    (line,) = run.stderr.strip().splitlines()
    assert said in line
    assert "odd" in line


def test_debug_shows_where_a_verb_failed(packages: Path) -> None:
    assert "in run" in ltvn(packages, "failing", "--debug").stderr


def test_a_result_that_json_cannot_hold_is_told(packages: Path) -> None:
    run = ltvn(packages, "unjsonable", "--json", "-")
    assert run.returncode == 1
    assert "JSON" in run.stderr.strip().splitlines()[-1]
    assert "Traceback" not in run.stderr


def test_a_verb_whose_options_cannot_be_read_spoils_no_completion(packages: Path) -> None:
    completed = ltvn(packages, "--tyro-print-completion", "bash")

    assert completed.returncode == 0
    assert "replay" in completed.stdout
