"""`python -m benchmarks.long_recording`: opens a recording of many hours, as the page and `ltvn why` do.

Each measurement runs in a process of its own, which reports its largest resident memory. The recording is made once
and kept in the folder. Owns the recording's contents: every step has an image, and a little more events than steps.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from benchmarks.measurement import Measurement

_STEPS_IN_HOUR = 36_000
_IMAGES = 100
_SEEKS = 21
_FLUSH_EVERY = 3
"""Steps in a batch: a recorder writes four times a second, which a faster writer must imitate."""


@dataclass(frozen=True)
class LongRecordingSummary:
    """Costs of a long recording against their budgets."""

    path: Path
    steps: int
    events: int
    size_mb: float
    measurements: "list[Measurement]"


@dataclass(frozen=True, kw_only=True)
class LongRecordingVerb(Verb):
    """Write a recording of many hours once, and measure opening, seeking, asking and verifying."""

    hours: Annotated[float, tyro.conf.arg(metavar="H")] = 8.0
    """Length of the recording. Eight hours take ten minutes to write, and 1 to 3 GB."""
    folder: Path = Path("runs/long")
    """Where the recording is kept and found again."""

    def run(self) -> Summary:
        """Write the recording if the folder does not have it, and measure."""
        from benchmarks.measurement import measured

        steps = round(self.hours * _STEPS_IN_HOUR)
        path = self.folder / f"steps-{steps}.rrd"
        if not path.exists():
            _write(path, steps)
        opened = _in_process("open_and_seek", path)
        asked = _in_process("ask_why", path)
        verified = _in_process("verify", path)
        size_mb = path.stat().st_size / 1e6
        rows = [
            measured("from disk to the first image", opened["open_s"], "s", at_most=3),
            measured("seek anywhere, with image and map", 1e3 * opened["seek_s"], "ms", at_most=100),
            measured("resident memory of the page's replay", opened["rss_mb"], "MB", at_most=1_000),
            measured("`ltvn why`, the question `failures`", asked["ask_s"], "s", at_most=10),
            measured("resident memory of `ltvn why`", asked["rss_mb"], "MB", at_most=1_000),
            measured("verify", size_mb / verified["verify_s"], "MB/s", at_least=200),
            measured("resident memory of verifying", verified["rss_mb"], "MB", at_most=1_000),
        ]
        return LongRecordingSummary(path, steps, int(opened["events"]), round(size_mb), rows)


def _write(path: Path, steps: int) -> None:
    from tqdm import tqdm

    from benchmarks.planning import NODES
    from benchmarks.recording import demo_observations
    from benchmarks.synthetic_run import synthetic_run
    from ltvn_core.data.recording.writer import RecordingWriter
    from ltvn_core.types import CONTROL_STEP_S

    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part.rrd")
    unfinished.unlink(missing_ok=True)
    images = demo_observations(_IMAGES)
    events = synthetic_run(steps - NODES)
    mapped, lived = events[: NODES - steps], events[NODES - steps :]
    with RecordingWriter(unfinished, scene="demo", config={}, fingerprint="") as writer:
        for step in tqdm(range(steps), desc="write", unit="step", mininterval=5):
            stamp = CONTROL_STEP_S * step
            writer.write_frame(replace(images[step % _IMAGES], step=step, stamp=stamp))
            happened = mapped if step == NODES else lived[step - NODES - 1 : step - NODES] if step > NODES else []
            for stamped in happened:
                writer.write_event(stamped._replace(step=step, stamp=stamp))
            if step % _FLUSH_EVERY == 0:
                writer._stream.flush()
    unfinished.rename(path)


def _in_process(job: str, path: Path) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.long_recording", job, str(path)], check=True, stdout=subprocess.PIPE
    )
    return json.loads(done.stdout)


def open_and_seek(path: Path) -> dict[str, float]:
    """Open the recording as the page does, show its end, and seek to random moments."""
    from ltvn_viz.session.activities.playback import open_replay
    from ltvn_viz.session.recording_library import RecordingLibrary

    start = time.perf_counter()
    replay = open_replay(RecordingLibrary(path.parent), path.name)
    replay.seek(replay.length_s)
    assert replay.camera(replay.moment().frame) is not None
    open_s = time.perf_counter() - start
    seeks = list[float]()
    for share in np.random.default_rng(0).uniform(size=_SEEKS):
        start = time.perf_counter()
        replay.seek(share * replay.length_s)
        replay.camera(replay.moment().frame)
        seeks.append(time.perf_counter() - start)
    return {"open_s": open_s, "seek_s": float(np.median(seeks)), "events": len(replay.timeline.events)}


def ask_why(path: Path) -> dict[str, float]:
    """Ask `ltvn why` what failed."""
    from ltvn_viz.debugger.file_context import FileCase
    from ltvn_viz.debugger.file_questions import FileAsk, ask_file

    start = time.perf_counter()
    ask_file(FileCase(path), FileAsk(question="failures"))
    return {"ask_s": time.perf_counter() - start}


def verify(path: Path) -> dict[str, float]:
    """Check every byte, row and image of the recording, as `ltvn verify` does."""
    from ltvn_core.data.recording.integrity import verify as verify_file

    start = time.perf_counter()
    verify_file(path)
    return {"verify_s": time.perf_counter() - start}


def _largest_memory_mb() -> float:
    # Not of `getrusage`: there a process begins with the number of the one that started it.
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.split("VmHWM:")[1].split()[0]) / 1e3


_JOBS: dict[str, Callable[[Path], dict[str, float]]] = {job.__name__: job for job in (open_and_seek, ask_why, verify)}


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] in _JOBS:
        costs = _JOBS[sys.argv[1]](Path(sys.argv[2]))
        costs["rss_mb"] = _largest_memory_mb()
        sys.stdout.write(json.dumps(costs))
    else:
        sys.exit(run_verb("python -m benchmarks.long_recording", LongRecordingVerb))
