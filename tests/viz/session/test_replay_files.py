"""Replays of real files, also where neither simulator nor network fits them."""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.data.recording.map_file import save_map
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import LtvnError, MapError, OptionError, RecordingError, SceneError
from ltvn_core.navigation.events import GraphChanged, Note, StampedEvent
from ltvn_core.types import Observation
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.activities.playback import open_replay
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.flat_world import tour
from tests.platforms import needs_posix
from tests.repository import DEMO_MAP, GOLDEN_RECORDING
from tests.viz.app_session import AppSession
from tests.viz.session_harness import SessionHarness, said

Opening = Callable[[AppOptions], AppState]


def with_random_image(seen: Observation, rng: np.random.Generator) -> Observation:
    """Give a blank picture something to see."""
    rgb = rng.integers(0, 255, (72, 96, 3), dtype=np.uint8)
    return Observation(rgb, seen.depth, seen.odometry, seen.stamp, seen.step, seen.exact_pose)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A finished recording in a scene that nobody here knows: a map, then a drive."""
    rng = np.random.default_rng(0)
    seen = [with_random_image(picture, rng) for picture in tour(((1.0, 1.0), (3.0, 1.0)), spins=False)]
    harness = SessionHarness(tmp_path / "unused", way=((1.0, 1.0), (3.0, 1.0)))
    path = tmp_path / "foreign.rrd"
    with RecordingWriter(path, scene="somewhere-else", config={}, fingerprint="flat") as writer:
        for picture in seen:
            writer.write_frame(picture)
        for delta in harness.state.live_map.graph.deltas():
            if not hasattr(delta, "frames"):
                writer.write_event(StampedEvent(seen[2].step, seen[2].stamp, GraphChanged(delta)))
        writer.write_event(StampedEvent(seen[-1].step + 9, seen[-1].stamp + 3.0, Note("the end")))
    return path


@pytest.fixture
def open_state() -> Iterator[Opening]:
    with ExitStack() as stack:
        yield lambda options: open_app_state(options, stack)


def test_a_recording_of_an_unknown_scene_is_watched_at_any_moment_without_robot_and_walls(recording: Path) -> None:
    with ExitStack() as stack:
        options = AppOptions(scene="somewhere-else", recordings=recording.parent, replay=recording.name)
        page = AppSession(stack, options)
        opened = page.do(c.OpenRecording(recording.name, at_s=1.5), ticks=2)
        assert opened.timeline.time_s == pytest.approx(1.5)
        shown = page.do(c.Seek(1e9))
        assert shown.mode is Mode.REPLAY
        assert shown.moment.robot is not None
        assert len(shown.moment.graph.ids) > 2
        assert shown.camera is not None
        shown = page.do(c.Ask(c.Action.CLOSE))
        assert shown.mode is Mode.TELEOP
        assert shown.moment.robot is None


def test_without_a_recording_to_watch_an_unknown_scene_is_an_error(open_state: Opening) -> None:
    with pytest.raises(SceneError):
        open_state(AppOptions(scene="somewhere-else", predictor="oracle"))


def test_a_replay_shows_the_images_of_the_file(recording: Path) -> None:
    replay = open_replay(RecordingLibrary(recording.parent), recording.name)
    replay.seek(1e9)
    moment = replay.moment()
    assert moment.frames > 5
    view = replay.camera(moment.frame)
    assert view is not None
    assert view.rgb.std() > 10


def test_a_cut_recording_says_how_to_mend_it(recording: Path) -> None:
    cut = recording.with_name("cut.rrd")
    cut.write_bytes(recording.read_bytes()[:-200])
    with pytest.raises(RecordingError, match="repair"):
        open_replay(RecordingLibrary(recording.parent), cut.name)


def test_a_foreign_file_is_a_clear_error_in_the_page(recording: Path, tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    (tmp_path / "holiday.rrd").write_bytes(b"not a recording")
    harness.state.open_replay = lambda name: open_replay(harness.library, name)
    shown = harness.do(c.OpenRecording("holiday.rrd"), ticks=2)
    assert shown.mode is Mode.TELEOP
    assert shown.work is None
    assert "holiday.rrd" in said(shown)


def test_a_file_on_which_reruns_reader_breaks_down_does_not_take_the_page_along(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    damaged = bytearray(GOLDEN_RECORDING.read_bytes())
    damaged[54_327] ^= 1 << 5
    (tmp_path / "damaged.rrd").write_bytes(damaged)
    harness.state.open_replay = lambda name: open_replay(harness.library, name)
    harness.do(c.Ask(c.Action.RECORD))
    shown = harness.do(c.OpenRecording("damaged.rrd"), ticks=2)
    assert shown.mode is Mode.TELEOP
    assert shown.recording.name is not None
    assert "ltvn repair" in said(shown)


def test_a_map_of_other_weights_is_refused(tmp_path: Path, open_state: Opening) -> None:
    harness = SessionHarness(tmp_path / "unused")
    live_map = harness.state.live_map
    path = tmp_path / "map.rrd"
    save_map(path, live_map.graph, live_map.map_observations(), scene="demo", config={}, fingerprint="older weights")
    with pytest.raises(MapError, match="older weights"):
        open_state(AppOptions(map=path, predictor="oracle", recordings=tmp_path))


def test_a_scene_that_contradicts_the_map_is_refused(tmp_path: Path, open_state: Opening) -> None:
    with pytest.raises(OptionError, match="--scene train-00 contradicts --map, which was made in demo"):
        open_state(AppOptions(scene="train-00", map=DEMO_MAP, predictor="oracle", recordings=tmp_path))


def test_a_recording_or_a_map_that_is_not_there_is_named(tmp_path: Path, open_state: Opening) -> None:
    watched = AppOptions(recordings=tmp_path, replay="gone.rrd")
    for options in (watched, AppOptions(recordings=tmp_path, map=tmp_path / "gone.rrd")):
        with pytest.raises(LtvnError, match=r"gone\.rrd"):
            open_state(options)


@needs_posix
def test_files_whose_names_are_not_utf_8_are_listed_apart_and_refused_with_advice(tmp_path: Path) -> None:
    for name in (b"caf\xe9.rrd", b"caf\xe8.rrd"):
        (tmp_path / os.fsdecode(name)).write_bytes(b"")
    (tmp_path / os.fsdecode(b"drive\xe9")).mkdir()
    (tmp_path / os.fsdecode(b"drive\xe9") / "map.db3").write_bytes(b"SQLite format 3\0")
    library = RecordingLibrary(tmp_path)
    assert set(library.names()) == {r"caf\xe9.rrd", r"caf\xe8.rrd"}
    assert os.fsencode(library.path(r"caf\xe9.rrd").name) == b"caf\xe9.rrd"
    assert [os.fsencode(library.source(name).name) for name in library.sources()] == [b"drive\xe9"]
    with pytest.raises(RecordingError, match="UTF-8"):
        open_replay(library, r"caf\xe9.rrd")
