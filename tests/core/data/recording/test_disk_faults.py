"""Disks that fill up, folders that go away: said at once, nobody waits, and what was written can be read."""

import re
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from ltvn_core.data.recording.appended_file import AppendedFile
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.rrf2.closing_record import RecordingEnding
from tests.core.data.recording.disk_faults import (
    FAULTS,
    FaultOutcome,
    KillOutcome,
    kill_while_recording,
    may_mount,
    strike,
)
from tests.platforms import needs_posix
from tests.repository import ROOT
from tests.waiting import until

pytestmark = needs_posix

NO_ROOM = r"No space left|is full"
"""Whether a write or the look at the free space meets the full disk first is the clock's choice."""
EXPECTED_WORDS = {
    "the file is deleted": "was deleted",
    "the folder is deleted": "was deleted",
    "the file may not grow": "File too large",
    "the disk fills up": "is full",
    "the disk fills up to the last byte": NO_ROOM,
    "the disk is full at once": NO_ROOM,
}
LOST_S = 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_a_disk_that_fails_is_said_once_and_what_was_written_can_be_read(tmp_path: Path, name: str) -> None:
    fault = FAULTS[name]
    if fault.needs_mount and not may_mount(tmp_path / "probe"):
        pytest.skip("making a small disk needs the right to mount one, as root has; other faults need no right")
    with strike(fault, tmp_path) as outcome:
        require_said_and_kept(outcome, name, tmp_path / "repaired.rrd")


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 80])
def test_a_process_that_is_killed_leaves_all_but_the_last_half_second(tmp_path: Path, steps: int) -> None:
    killed = kill_while_recording(tmp_path / "killed.rrd", steps_before=steps)
    assert lost_by(killed, tmp_path / "repaired.rrd") <= LOST_S


def require_said_and_kept(outcome: FaultOutcome, name: str, repaired: Path) -> None:
    """Hold a recording process to what is promised: it says the fault once, goes on, ends, and keeps what it wrote."""
    assert re.search(EXPECTED_WORDS.get(name, "no longer in its place"), outcome.told), outcome.errors
    assert " AND " not in outcome.told
    assert outcome.steps_after >= 20, outcome.errors
    assert (outcome.exit_code, outcome.errors) == (0, "")
    if outcome.recording is not None:
        kept = frames_of(outcome.recording, repaired, finished=not FAULTS[name].leaves_no_room)
        lost = [at for step, at in outcome.step_times.items() if step >= kept and at < outcome.struck_s - LOST_S]
        assert not lost
        assert kept >= 10


def lost_by(killed: KillOutcome, repaired: Path) -> float:
    """Return how many seconds of a drive a kill cost; what is left must be whole once repaired."""
    saved = repair(killed.recording, repaired)
    assert verify(repaired).frames == saved.frames
    return killed.lost_s(saved.last_step)


def frames_of(recording: Path, repaired: Path, *, finished: bool) -> int:
    """Return how many frames can be read, at once or, where the file found no room for its end, after a repair."""
    if finished:
        return verify(recording).frames
    repair(recording, repaired)
    return verify(repaired).frames


class _PlainEnding(RecordingEnding):
    """Ends a file with a word, or with the `long_ending` where there is room, and counts nothing."""

    def __init__(self, long_ending: bytes = b"") -> None:
        """Keep the long ending."""
        super().__init__("")
        self._long = long_ending

    def count(self, block: bytes) -> None:
        """Take no note."""

    def encoded(self, *, complete: bool, is_short: bool = False) -> bytes:
        word = b" end" if complete else b" cut"
        return word if is_short else self._long + word


def appended(path: Path, blocks: Sequence[bytes], long_ending: bytes = b"") -> AppendedFile:
    file = AppendedFile(path, min_free_bytes=1, ending=_PlainEnding(long_ending))
    for block in blocks:
        file.append([block])
    return file


def test_blocks_stand_in_the_file_in_their_order_and_then_the_ending(tmp_path: Path) -> None:
    file = appended(tmp_path / "a", [b"one", b"two"])
    assert file.wait_until_written(at_most_s=60)
    assert (tmp_path / "a").read_bytes() == b"onetwo"
    file.close()
    assert (tmp_path / "a").read_bytes() == b"onetwo end"
    assert file.failure is None


def test_a_full_disk_takes_all_or_none_of_what_belongs_together_and_a_short_ending(tmp_path: Path) -> None:
    program = """
import resource, signal, sys
from pathlib import Path
from tests.core.data.recording.test_disk_faults import appended
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
folder = Path(sys.argv[1])
torn = appended(folder / "torn", [b"12345"])
torn.append([b"67", b"89", b"too much"])
short = appended(folder / "short", [b"12345"], long_ending=b"a table")
for file in (torn, short):
    file.close()
    print(file.failure and file.failure.text)
"""
    run = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True, cwd=ROOT
    )
    first, second = run.stdout.splitlines()
    assert "File too large" in first
    assert (tmp_path / "torn").read_bytes() == b"12345 cut"
    assert second == "None"
    assert (tmp_path / "short").read_bytes() == b"12345 end"


def test_only_the_owner_may_read_a_recording(tmp_path: Path) -> None:
    appended(tmp_path / "a", []).close()
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o600


def test_a_disk_that_is_far_behind_ends_the_recording_instead_of_filling_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, free = __import__("os").write, threading.Event()

    def stuck(file: int, data: bytes) -> int:
        free.wait()
        return write(file, data)

    monkeypatch.setattr("ltvn_core.data.recording.appended_file.os.write", stuck)
    file = appended(tmp_path / "a", [])
    block = bytes(1 << 20)
    for _ in range(1000):
        file.append([block])  # Never waits.
    assert "is too slow" in (file.failure.text if file.failure else "")
    assert file.waiting_bytes < 80 << 20
    free.set()
    file.close()
    assert until(lambda: (tmp_path / "a").read_bytes().endswith(b" cut"))
