"""A failure ends with one line that says what to do, and with the exit code that shells expect."""

import errno
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from ltvn_core.atomic_files import require_new_path
from ltvn_core.cli import CLOSED_PIPE, FAILED, INTERRUPTED, run_verb
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.verbs.verb import Summary, Verb
from tests.platforms import needs_posix
from tests.repository import DEMO_MAP

FAILURES: dict[str, tuple[BaseException, int, str]] = {
    "full": (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/disk/a.rrd"), FAILED, "free some space"),
    "read-only": (OSError(errno.EROFS, os.strerror(errno.EROFS), "/disk/a.rrd"), FAILED, "can be written to"),
    "forbidden": (PermissionError(errno.EACCES, os.strerror(errno.EACCES), "/disk/a.rrd"), FAILED, "you may use"),
    "long": (OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), "x" * 300), FAILED, "shorter name"),
    "temporary": (
        FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']"),
        FAILED,
        "set TMPDIR",
    ),
    "interrupted": (KeyboardInterrupt(), INTERRUPTED, "interrupted"),
    "memory": (MemoryError("Unable to allocate 5 TiB"), FAILED, "not enough memory (Unable to allocate 5 TiB)"),
    "text": (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), FAILED, "not UTF-8"),
    "huge": (OverflowError("int too large to convert to float"), FAILED, "a number is too large"),
    "lines": (OptionError("first line\n  second line"), FAILED, "ltvn: first line second line"),
}


@dataclass(frozen=True, kw_only=True)
class FailingVerb(Verb):
    """Fails as it is told."""

    how: Annotated[str, tyro.conf.arg(help="A key of FAILURES.")] = "full"

    def run(self) -> Summary:
        raise FAILURES[self.how][0]


@pytest.mark.parametrize("how", FAILURES)
def test_a_failure_becomes_one_line(how: str, capfd: pytest.CaptureFixture[str]) -> None:
    _, code, said = FAILURES[how]

    assert run_verb("ltvn fail", FailingVerb, ["--how", how]) == code

    (line,) = capfd.readouterr().err.strip().splitlines()
    assert line.startswith("ltvn: ")
    assert said in line


def test_the_traceback_is_there_for_who_asks(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run_verb("ltvn fail", FailingVerb, ["--debug"])
    assert "Traceback" in capfd.readouterr().err
    monkeypatch.setenv("LTVN_DEBUG", "1")
    run_verb("ltvn fail", FailingVerb, [])
    assert "Traceback" in capfd.readouterr().err


def test_a_mistake_of_a_programmer_is_shown_as_one() -> None:
    class Mistaken(FailingVerb):
        def run(self) -> Summary:
            raise AssertionError("our own fault")

    with pytest.raises(AssertionError, match="our own fault"):
        run_verb("ltvn fail", Mistaken, [])


@needs_posix
@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        ("{ltvn} --help", CLOSED_PIPE, ""),
        ("{ltvn} info {odd}", FAILED, "not UTF-8"),
        ("TMPDIR=/proc/none {ltvn} verify {odd}/.. ", FAILED, "ltvn: "),
        ("{ltvn} info {long}", FAILED, "shorter name"),
    ],
    ids=["closed pipe", "name that is not UTF-8", "no temporary folder", "very long name"],
)
def test_the_program_itself_never_shows_a_traceback(tmp_path: Path, command: str, code: int, said: str) -> None:
    odd = os.path.join(os.fsencode(tmp_path), b"caf\xe9.rrd")
    Path(os.fsdecode(odd)).write_bytes(b"RRF2")
    program = f"{sys.executable} -m ltvn_core.cli"
    line = command.format(ltvn=program, odd=os.fsdecode(odd), long="x/" * 3000).encode("utf-8", "surrogateescape")
    closed, end = os.pipe()
    os.close(closed)
    run = subprocess.run(line, shell=True, stdout=end if code == CLOSED_PIPE else None, stderr=subprocess.PIPE)
    os.close(end)
    assert run.returncode == code, run.stderr
    assert b"Traceback" not in run.stderr
    assert b"Exception ignored" not in run.stderr
    assert said.encode() in run.stderr


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("a\0b.rrd", "NUL"),
        ("caf\udce9.rrd", "not UTF-8"),
        ("\ud800", "not UTF-8"),
        ("x" * 300, "shorter name"),
        ("y/" * 3000, "shorter name"),
    ],
    ids=["NUL", "not UTF-8", "lone surrogate", "long name", "long path"],
)
def test_a_name_that_no_file_can_have_is_said(tmp_path: Path, name: str, said: str) -> None:
    path = tmp_path / name
    for use in (Recording.open, require_new_path):
        with pytest.raises(RecordingError, match=said):
            use(path)
    with pytest.raises(RecordingError):
        RecordingWriter(path, scene="", config={}, fingerprint="")


@dataclass(frozen=True, kw_only=True)
class CountingVerb(FailingVerb):
    """Has the numbers that verbs have."""

    seed: tuple[int, ...] = (0,)
    queries: int = 1
    goal: int | None = None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--seed", "0", "-1"], "--seed must be 0 or more, got -1"),
        (["--queries", str(10**30)], "1,000,000"),
        (["--goal", str(10**400)], "--goal must be at most"),
    ],
)
def test_numbers_that_no_verb_can_use_are_refused_before_anything_begins(
    options: list[str], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run_verb("ltvn count", CountingVerb, options) == FAILED
    assert said in capfd.readouterr().err


@needs_posix
@pytest.mark.slow
@pytest.mark.parametrize("closed", [">&-", "<&- 2>&-"])
def test_a_command_works_where_standard_streams_are_closed(tmp_path: Path, closed: str) -> None:
    program = f"{sys.executable} -m ltvn_core.cli export {DEMO_MAP} --to graphml --output map.graphml {closed}"
    run = subprocess.run(["bash", "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, "Traceback" in run.stderr) == (0, False)
    assert (tmp_path / "map.graphml").read_text(encoding="utf-8").startswith("<?xml")


@needs_posix
def test_a_name_in_utf8_is_not_called_something_else_where_python_does_not_read_utf8(tmp_path: Path) -> None:
    path = tmp_path / "Büro.rrd"
    path.touch()
    run = subprocess.run(
        [sys.executable, "-m", "ltvn_core.cli", "info", str(path)],
        env=os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        capture_output=True,
    )
    assert run.returncode == FAILED
    assert b"PYTHONUTF8" in run.stderr
    assert b"not UTF-8" not in run.stderr


@needs_posix
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can become an unknown user")
def test_a_user_without_a_home_gets_a_cache_among_the_temporary_files() -> None:
    without = {name: text for name, text in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    with tempfile.TemporaryDirectory() as folder:  # Not pytest's, which only root may enter.
        Path(folder).chmod(0o777)
        program = (
            "import os, ltvn_core.cache_folder as c; os.setuid(23456); "
            f"c.tempfile.tempdir = {folder!r}; c._temporary_folder(); print(c.cache_folder(), c.cache_folder())"
        )
        run = subprocess.run([sys.executable, "-c", program], env=without, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    first, second = run.stdout.split()
    assert first == second == f"{folder}/ltvn-cache-23456"
    assert run.stderr.count("no home folder") == 1
