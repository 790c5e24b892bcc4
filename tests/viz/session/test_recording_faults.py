"""What the page says, and does not wait for, when a recording fails or a disk does not answer."""

import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.types import Twist
from ltvn_viz.session.recorder import DaemonExecutor
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import FakeWriter, SessionHarness, said
from tests.waiting import until


def open_file(path: Path) -> RecordingWriter:
    return RecordingWriter(path, scene="flat", config={}, fingerprint="flat", patience_s=0)


@pytest.fixture
def harness(tmp_path: Path) -> Iterator[SessionHarness]:
    harness = SessionHarness(tmp_path / "drives", open_writer=open_file, recording_executor=DaemonExecutor("recorder"))
    harness.wait()
    yield harness
    harness.session.close()


def begin(harness: SessionHarness) -> Path:
    harness.do(c.Ask(c.Action.RECORD))
    shown = harness.until(lambda now: now.recording.name is not None)
    return harness.library.folder / str(shown.recording.name)


def frames_on_disk(path: Path) -> int:
    """Return how many images of a recording under way are safe by now."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return repair(path, Path(folder) / "so-far.rrd").frames
        except RecordingError:
            return 0  # Not even its description is.


def drive_on(harness: SessionHarness) -> None:
    before = harness.robot.state().odometry
    harness.driver.twist = Twist(0.3, 0.0)
    harness.wait(10)
    harness.driver.twist = None
    harness.wait(2)
    assert (harness.robot.state().odometry != before).any()


def test_a_file_that_is_taken_away_while_the_robot_stands_is_said_and_driving_goes_on(harness: SessionHarness) -> None:
    begin(harness).unlink()
    shown = harness.until(lambda now: now.recording.name is None)
    assert "was deleted" in said(shown)
    drive_on(harness)


def test_a_query_goes_on_when_its_recording_fails(harness: SessionHarness) -> None:
    path = begin(harness)
    harness.do(c.Ask(c.Action.GOAL, int(harness.now.moment.graph.ids[-1])))
    harness.until(lambda now: now.mode is Mode.NAVIGATING)
    until(lambda: frames_on_disk(path) > 0)  # No time passes for the robot meanwhile.
    path.rename(path.with_name("elsewhere.rrd"))
    shown = harness.until(lambda now: now.recording.name is None)
    assert "elsewhere.rrd" in said(shown)
    ended = harness.until(lambda now: now.mode is Mode.TELEOP)
    assert ended.moment.progress.goal == int(harness.now.moment.graph.ids[-1])
    until(lambda: not harness.state.live.recorder.is_on)
    harness.session.close()
    assert verify(path.with_name("elsewhere.rrd")).frames > 0


def test_the_next_recording_begins_after_one_that_failed(harness: SessionHarness) -> None:
    begin(harness).unlink()
    harness.until(lambda now: now.recording.name is None)
    path = begin(harness)
    harness.do(c.Ask(c.Action.KEEP))
    harness.until(lambda now: now.recording.name is None)
    assert Recording.open(path).final_graph().nodes


def test_the_file_is_there_while_the_navigator_still_thinks(tmp_path: Path) -> None:
    thinking, thought = threading.Event(), threading.Event()

    def think() -> None:
        thinking.set()
        thought.wait()

    worker = DaemonExecutor("worker")
    harness = SessionHarness(
        tmp_path, open_writer=open_file, executor=worker, recording_executor=DaemonExecutor("recorder")
    )
    harness.state.worker.submit(think, lambda _result: None)
    thinking.wait()
    path = begin(harness)
    assert path.stat().st_size > 0
    drive_on(harness)
    thought.set()
    harness.do(c.Ask(c.Action.KEEP))
    harness.until(lambda now: now.recording.name is None)
    recording = Recording.open(path)
    assert recording.final_graph().nodes == harness.state.live_map.graph.nodes
    harness.session.close()


class _StuckWriter(FakeWriter):
    """A writer whose end waits for a disk."""

    answers: threading.Event

    def close(self) -> None:
        self.answers.wait()
        super().close()


@pytest.fixture
def disk_answers() -> Iterator[threading.Event]:
    answers = threading.Event()
    yield answers
    answers.set()


def test_the_session_waits_neither_for_a_file_to_begin_nor_to_end(
    tmp_path: Path, disk_answers: threading.Event
) -> None:
    made = list[FakeWriter]()

    def open_slowly(path: Path) -> FakeWriter:
        disk_answers.wait()
        writer = _StuckWriter(path)
        writer.answers = disk_answers
        made.append(writer)
        return writer

    harness = SessionHarness(tmp_path, open_writer=open_slowly, recording_executor=DaemonExecutor("recorder"))
    harness.do(c.Ask(c.Action.RECORD))
    drive_on(harness)
    disk_answers.set()
    harness.until(lambda now: now.recording.frames > 0)
    disk_answers.clear()
    harness.do(c.Ask(c.Action.KEEP))
    drive_on(harness)
    assert not made[0].closed
    disk_answers.set()
    shown = harness.until(lambda now: now.recording.name is None)
    assert made[0].closed
    assert "Kept as" in said(shown)
    harness.session.close()
