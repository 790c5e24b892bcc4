"""Things that go wrong with a disk while a real process records onto it; for tests and campaigns.

Owns the faults and the recording process. Asserts nothing: who calls judges the `FaultOutcome`.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from tests.repository import ROOT
from tests.waiting import PATIENCE_S, until

RECORDER = """
import resource, signal, sys, time
from pathlib import Path
from ltvn_core.errors import RecordingError
from ltvn_core.data.recording.writer import RecordingWriter
from tests.core.data.recording import example_recording

path, min_free_bytes, file_limit = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))
if file_limit:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))
about = dict(scene="demo", config={}, fingerprint="", min_free_bytes=min_free_bytes, patience_s=0)
with RecordingWriter(path, **about) as writer:
    for step in range(10**6):
        try:
            writer.write_frame(example_recording.observation(step))
        except RecordingError as error:
            print("told", time.monotonic(), " ".join(str(error).split()), flush=True)
        print("step", time.monotonic(), step, flush=True)
        time.sleep(0.01)
"""
ROOM_BYTES = 8 << 20
LITTLE_BYTES = 300_000
"""Room for some dozen frames."""


class Place(NamedTuple):
    """Where a fault strikes."""

    folder: Path
    """The folder of the recording, on a disk of its own where there is one."""
    file: Path
    """The recording."""
    aside: Path
    """A folder on another disk, for what is moved away."""


Strike = Callable[[Place], Path | None]
"""Lets a fault happen and returns where the recording can be read afterwards; None where it is lost on purpose."""


@dataclass(frozen=True)
class DiskFault:
    """One way in which a disk lets a recording down."""

    strike: Strike
    needs_mount: bool = False
    """Only who may mount can make it happen."""
    min_free_bytes: int = 1
    file_limit: int = 0
    """Bytes beyond which the file cannot grow, 0 for any."""
    comes_later: bool = False
    """It strikes only when the recording has grown some more."""
    leaves_no_room: bool = False
    """Not even the end of the file finds room, so that reading it takes `ltvn repair`."""


@dataclass
class FaultOutcome:
    """What a recording process did about a fault."""

    struck_s: float
    told: str
    """What the writer raised."""
    told_after_s: float
    steps_after: int
    """How often the robot went on after it was told."""
    ended_after_s: float
    """From SIGTERM to the end of the process."""
    exit_code: int
    errors: str
    recording: Path | None
    step_times: Mapping[int, float] = field(repr=False)
    """Step -> when it was written."""


def _delete_file(place: Place) -> None:
    place.file.unlink()


def _delete_folder(place: Place) -> None:
    place.file.unlink()
    place.file.parent.rmdir()


def _rename_file(place: Place) -> Path:
    return place.file.rename(place.file.with_name("elsewhere.rrd"))


def _rename_folder(place: Place) -> Path:
    return place.file.parent.rename(place.folder / "elsewhere") / place.file.name


def _replace_file(place: Place) -> Path:
    kept = place.file.rename(place.file.with_name("elsewhere.rrd"))
    place.file.write_bytes(b"mine")
    return kept


def _unmount(place: Place) -> Path:
    # A second way to the same disk, because what has none any more is gone.
    place.aside.mkdir()
    subprocess.run(["mount", "--bind", place.folder, place.aside], check=True)
    subprocess.run(["umount", "--lazy", place.folder], check=True)
    return place.aside / place.file.relative_to(place.folder)


def _fill(place: Place) -> Path:
    with (place.folder / "filler").open("wb", buffering=0) as filler:
        try:
            while filler.write(bytes(4096)):
                pass
        except OSError:
            pass
    return place.file


def _leave_little(place: Place) -> Path:
    free = os.statvfs(place.folder)
    (place.folder / "filler").write_bytes(bytes(free.f_bavail * free.f_frsize - LITTLE_BYTES))
    return place.file


def _let_grow(place: Place) -> Path:
    return place.file


FAULTS: Mapping[str, DiskFault] = {
    "the file is deleted": DiskFault(_delete_file),
    "the folder is deleted": DiskFault(_delete_folder),
    "the file is renamed": DiskFault(_rename_file),
    "the folder is renamed": DiskFault(_rename_folder),
    "another file takes its name": DiskFault(_replace_file),
    "the file may not grow": DiskFault(_let_grow, comes_later=True, file_limit=400_000, leaves_no_room=True),
    "the disk is unmounted": DiskFault(_unmount, needs_mount=True),
    "the disk is full at once": DiskFault(_fill, needs_mount=True, leaves_no_room=True),
    "the disk fills up": DiskFault(_leave_little, needs_mount=True, comes_later=True, min_free_bytes=LITTLE_BYTES // 2),
    "the disk fills up to the last byte": DiskFault(
        _leave_little, needs_mount=True, comes_later=True, leaves_no_room=True
    ),
}


def may_mount(folder: Path) -> bool:
    """Tell whether small disks can be made here."""
    folder.mkdir(parents=True, exist_ok=True)
    with _small_disk(folder) as mounted:
        return mounted


@contextmanager
def _small_disk(folder: Path) -> Iterator[bool]:
    """Put a disk of a few megabytes onto a folder while the block runs; yields whether that is allowed."""
    mount = ["mount", "-t", "tmpfs", "-o", f"size={ROOM_BYTES}", "none", str(folder)]
    mounted = sys.platform == "linux" and subprocess.run(mount, capture_output=True).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", folder], capture_output=True)


@contextmanager
def strike(fault: DiskFault, folder: Path, *, steps_before: int = 60, steps_after: int = 20) -> Iterator[FaultOutcome]:
    """Record in a process, let the fault happen, go on a little, end the process, and yield what came of it.

    The recording can be read while the block runs. The process is given up after a long time.
    """
    place = Place(folder / "disk", folder / "disk" / "drives" / "drive.rrd", folder / "aside")
    place.folder.mkdir(parents=True)
    with _small_disk(place.folder) if fault.needs_mount else _plain():
        arguments = [str(place.file), str(fault.min_free_bytes), str(fault.file_limit)]
        run = RecordingProcess(arguments)
        try:
            until(lambda: len(run.step_times) >= steps_before or run.over)
            recording, struck_s = fault.strike(place), time.monotonic()
            until(lambda: run.told or run.over)
            last = len(run.step_times)
            until(lambda: len(run.step_times) >= last + steps_after or run.over)
            ended_after_s = run.end()
            yield FaultOutcome(
                struck_s=struck_s,
                told=run.told,
                told_after_s=run.told_s - struck_s,
                steps_after=len(run.step_times) - last,
                ended_after_s=ended_after_s,
                exit_code=run.process.returncode,
                errors=run.errors,
                recording=recording,
                step_times=run.step_times,
            )
        finally:
            run.kill()
            subprocess.run(["umount", "--lazy", place.aside], capture_output=True)


@contextmanager
def _plain() -> Iterator[None]:
    yield


class KillOutcome(NamedTuple):
    """What a killed recording process left."""

    recording: Path
    last_written_s: float
    step_times: Mapping[int, float]
    """Step -> when it was written."""

    def lost_s(self, last_step: int | None) -> float:
        """Return how much of the drive is missing in a file whose last frame is `last_step`."""
        kept_s = min(self.step_times.values()) if last_step is None else self.step_times[last_step]
        return self.last_written_s - kept_s


def kill_while_recording(path: Path, *, steps_before: int) -> KillOutcome:
    """Record in a process and kill it after so many steps."""
    run = RecordingProcess([str(path), "1", "0"])
    try:
        until(lambda: len(run.step_times) >= steps_before or run.over)
    finally:
        run.kill()
    return KillOutcome(path, max(run.step_times.values()), run.step_times)


class RecordingProcess:
    """A process that records for ever, and what it says."""

    def __init__(self, arguments: list[str]) -> None:
        self.step_times: dict[int, float] = {}
        self.told, self.told_s, self.errors = "", 0.0, ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", RECORDER, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def over(self) -> bool:
        return self.process.poll() is not None

    def end(self) -> float:
        """Ask the process to end and return how long that took, in seconds."""
        began = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(PATIENCE_S)
        took = time.monotonic() - began
        self._reader.join()
        assert self.process.stderr is not None
        self.errors = self.process.stderr.read()
        return took

    def kill(self) -> None:
        """End the process if it still runs, and let go of it."""
        self.process.kill()
        self._reader.join()
        with self.process:
            pass  # Leaving closes its pipes.

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            kind, _, rest = line.rstrip("\n").partition(" ")
            moment, _, text = rest.partition(" ")
            if not text:
                continue  # Ended in the middle of a line.
            if kind == "told":
                self.told_s = float(moment)
                self.told = text if not self.told else f"{self.told} AND {text}"
            else:
                self.step_times[int(text)] = float(moment)
