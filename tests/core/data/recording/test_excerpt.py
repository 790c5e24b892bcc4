"""A moment is cut out of a recording, whole in itself, and with a test that it passes."""

import subprocess
import sys
from pathlib import Path

import pytest

from ltvn_core.data.recording.excerpt import event_window, write_excerpt
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.navigation.events import AttemptEnded, ChangedBy, QueryStarted, StampedEvent, WorldChanged
from ltvn_core.worlds import DoorMoved
from tests.core.data.recording import example_recording
from tests.program import ltvn_here
from tests.repository import DEMO_DRIVE, ROOT


@pytest.fixture
def drive(tmp_path: Path) -> Recording:
    example_recording.write(tmp_path / "drive.rrd", frames=20)
    return Recording.open(tmp_path / "drive.rrd")


def test_a_moment_in_the_middle_of_a_query_stands_alone(tmp_path: Path) -> None:
    whole, (from_s, to_s) = Recording.open(DEMO_DRIVE), (170.0, 175.0)
    written = write_excerpt(whole, tmp_path / "moment.rrd", from_s=from_s, to_s=to_s)
    verify(tmp_path / "moment.rrd")
    part = Recording.open(tmp_path / "moment.rrd")
    first, last = (next(s.step for s in events if from_s <= s.stamp <= to_s) for events in _both_ends(whole.events))
    assert part.final_graph() == whole.graph_at(last)
    assert part.graph_at(first - 1) != part.final_graph()
    assert event_window(whole.events, from_s, to_s).graph_before == event_window(part.events, from_s, to_s).graph_before
    inside = [stamped for stamped in whole.events if from_s <= stamped.stamp <= to_s]
    assert part.events[-len(inside) :] == inside
    assert any(isinstance(stamped.event, QueryStarted) for stamped in part.events)
    assert load_map(tmp_path / "moment.rrd").graph == part.final_graph()
    assert written.size_bytes < DEMO_DRIVE.stat().st_size
    assert part.stored_frame(part.frames[0]).frame.rgb == whole.stored_frame(part.frames[0]).frame.rgb


def _both_ends(events: list[StampedEvent]) -> tuple[list[StampedEvent], list[StampedEvent]]:
    return events, events[::-1]


def test_only_the_named_images_make_a_much_smaller_file(tmp_path: Path) -> None:
    whole = Recording.open(DEMO_DRIVE)
    small = write_excerpt(whole, tmp_path / "small.rrd", from_s=170.0, to_s=172.0, named_only=True)
    assert small.size_bytes < DEMO_DRIVE.stat().st_size / 4
    verify(small.output)
    held = Recording.open(small.output)
    attempts_ended = [stamped.event for stamped in held.events if isinstance(stamped.event, AttemptEnded)]
    assert all(
        attempt_ended.target in held.frames and attempt_ended.frame in held.frames for attempt_ended in attempts_ended
    )


@pytest.mark.parametrize(("from_s", "to_s"), [(900.0, 901.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_a_time_that_is_not_there_is_refused(drive: Recording, tmp_path: Path, from_s: float, to_s: float) -> None:
    with pytest.raises(RecordingError, match=r"runs from 0\.0 s to 1\.9 s"):
        write_excerpt(drive, tmp_path / "none.rrd", from_s=from_s, to_s=to_s)
    assert not (tmp_path / "none.rrd").exists()


def test_a_recording_is_never_overwritten(drive: Recording) -> None:
    with pytest.raises(RecordingError, match="never overwritten"):
        write_excerpt(drive, drive.path, from_s=0.0, to_s=1.0)


def test_events_out_of_order_keep_their_order_and_their_map(drive: Recording) -> None:
    events = list(drive.events)
    events[9], events[4] = events[4], events[9]
    with_map = [s for s in events if s.event != events[4].event]
    found = event_window(with_map, 0.3, 1.2)
    place = with_map.index(found.events[0])
    assert list(found.events) == with_map[place : place + len(found.events)]


def test_a_moment_begins_in_the_world_as_it_was_then(tmp_path: Path) -> None:
    def door(number: int, *, is_open: bool) -> WorldChanged:
        return WorldChanged(DoorMoved(number, is_open), ChangedBy.SCRIPT, 60.0)

    path = tmp_path / "drive.rrd"
    changes_at = {1: [door(2, is_open=False), door(3, is_open=False)], 2: [door(2, is_open=True)]}
    with RecordingWriter(path, scene="demo", config={}, fingerprint="abc") as writer:
        for step in range(6):
            writer.write_frame(example_recording.observation(step))
            stamp = example_recording.observation(step).stamp
            for event in changes_at.get(step, ()):
                writer.write_event(StampedEvent(step, stamp, event))
    from_s = example_recording.observation(4).stamp
    write_excerpt(Recording.open(path), tmp_path / "moment.rrd", from_s=from_s, to_s=from_s + 1.0)
    told = [stamped.event for stamped in Recording.open(tmp_path / "moment.rrd").events]
    world = [event for event in told if isinstance(event, WorldChanged)]
    assert world == [door(2, is_open=True), door(3, is_open=False)]


@pytest.mark.slow
def test_the_test_that_is_written_passes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = ["--output", tmp_path / "moment.rrd", "--test", tmp_path / "test_moment.py"]
    run = ltvn_here(capsys, "export", DEMO_DRIVE, "--from", "165", "--to", "175", *files)
    assert run.code == 0, run.stderr
    passed = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path / "test_moment.py"],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert passed.returncode == 0, passed.stdout


@pytest.mark.slow
def test_a_page_and_a_figure_ask_nothing_of_another_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = ltvn_here(capsys, "export", DEMO_DRIVE, "--html", tmp_path / "map.html", "--svg", tmp_path / "map.svg")
    assert run.code == 0, run.stderr
    page, figure = ((tmp_path / name).read_text(encoding="utf-8") for name in ("map.html", "map.svg"))
    assert "180 nodes, 528 edges" in page
    # What the page asks for in a browser is tested there; by its own policy it is nothing.
    assert "default-src 'none'" in page
    assert "edge 814 to 820" in figure
    assert "http" not in figure.replace("http://www.w3.org/2000/svg", "")


def test_there_must_be_something_to_write(drive: Recording, capsys: pytest.CaptureFixture[str]) -> None:
    assert "give --output" in ltvn_here(capsys, "export", drive.path).stderr
