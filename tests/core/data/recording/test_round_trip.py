"""What goes into a recording comes out again."""

import os
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from ltvn_core import worlds as w
from ltvn_core.data.recording import mapped_batches
from ltvn_core.data.recording.event_codec import decode_event, encode_event
from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.map_file import check_fingerprint, load_map, save_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import MapError, RecordingError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import ChangedBy, Event, GraphChanged, Note, StampedEvent, WorldChanged
from tests.core.data.recording import example_recording
from tests.repository import DEMO_FAULT


@pytest.fixture(autouse=True)
def strict() -> Iterator[None]:
    """Let Rerun raise where it would only warn."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "drive.rrd"


numbers = st.floats(allow_nan=False, width=64)
finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
poses = st.builds(d.PoseRow, numbers, numbers, numbers)
causes = st.sampled_from(d.Cause)
ids = st.integers(0, 10**9)
beliefs = st.builds(d.Belief, numbers, numbers, numbers)
frames = st.lists(ids, max_size=4).map(tuple)
edges = st.builds(d.Edge, ids, ids, poses, beliefs, ids, ids, st.booleans(), action=st.text(max_size=8))
deltas: st.SearchStrategy[d.GraphDelta] = st.one_of(
    st.builds(d.NodeAdded, st.builds(d.Node, ids, poses, st.text(max_size=8), st.booleans()), causes),
    st.builds(d.NodeDropped, ids, causes),
    st.builds(
        d.EdgeAdded,
        st.builds(d.Edge, ids, ids, poses, beliefs, ids, ids, st.booleans(), action=st.text(max_size=8)),
        causes,
    ),
    st.builds(d.BeliefUpdated, ids, ids, beliefs, ids, ids, causes),
    st.builds(d.EdgePruned, ids, ids, causes),
    st.builds(d.EdgeProtected, ids, ids, st.booleans(), causes),
    st.builds(d.EdgeActionSet, ids, ids, st.text(max_size=8), causes),
    st.builds(d.PresenceObserved, ids, ids, st.booleans(), finite, causes),
    st.builds(d.NodeNamed, ids, st.text(max_size=8), st.booleans(), causes),
    st.builds(d.FramesReserved, frames, causes),
    st.builds(d.FramesReleased, frames, causes),
)
changes = st.builds(GraphChanged, deltas, st.none() | ids, st.none() | ids)
names = st.text(max_size=8)
rows = st.tuples(numbers, numbers, numbers)
world_changes = st.one_of(
    st.builds(w.DoorMoved, ids, st.booleans()),
    st.builds(w.ThingPlaced, names, st.sampled_from(w.ThingKind), rows, rows),
    st.builds(w.ThingRemoved, names),
    st.builds(w.ThingReturned, names),
    st.builds(w.LightChanged, numbers, numbers),
    st.builds(w.PicturesExchanged, st.none() | ids),
    st.builds(w.PersonMoved, names, rows, ids),
    st.builds(w.PersonLeft, names),
    st.builds(w.TimePassed, numbers),
)
outlines = st.builds(w.Outline, *[numbers] * 6)
world_events = st.builds(WorldChanged, world_changes, st.sampled_from(ChangedBy), numbers, st.none() | outlines)


@given(changes | world_events | st.sampled_from(example_recording.events()))
def test_every_event_returns_equal(event: Event) -> None:
    assert decode_event(encode_event(event)) == event


def test_texts_that_are_not_utf_8_are_recorded_and_come_back_readable(tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9")
    with RecordingWriter(tmp_path / "a.rrd", scene=name, config={"place": name}, fingerprint="") as writer:
        writer.write_event(StampedEvent(0, 0.0, Note(f"{name} \ud800")))
    recording = Recording.open(tmp_path / "a.rrd")
    assert recording.meta.scene == recording.meta.config["place"] == r"caf\xe9"
    assert [stamped.event for stamped in recording.events] == [Note("caf\\xe9 \ufffd")]


def test_events_and_poses_return_exactly_and_images_nearly(path: Path) -> None:
    written = example_recording.write(path)
    recording = Recording.open(path)
    assert recording.events == written
    for step in recording.frames:
        before, after = example_recording.observation(step), recording.observation(step)
        assert np.array_equal(before.odometry, after.odometry)
        assert before.exact_pose is not None
        assert after.exact_pose is not None
        assert np.array_equal(before.exact_pose, after.exact_pose)
        assert (before.stamp, before.step) == (after.stamp, after.step)
        assert np.abs(before.require_depth("the test") - after.require_depth("the test")).max() <= 0.0005 + 1e-6
        assert np.abs(before.rgb.astype(int) - after.rgb).mean() < 3


def test_a_rewritten_recording_holds_the_same(path: Path, tmp_path: Path) -> None:
    example_recording.write(path)
    first, again = Recording.open(path), tmp_path / "again.rrd"
    with RecordingWriter(again, scene=first.meta.scene, config=first.meta.config, fingerprint="abc") as writer:
        for frame in first.frames:
            writer.write_encoded_frame(first.stored_frame(frame).frame)
        for event in first.events:
            writer.write_event(event)
    second = Recording.open(again)
    assert second.events == first.events
    assert [second.stored_frame(f) for f in second.frames] == [first.stored_frame(f) for f in first.frames] or all(
        second.stored_frame(f).frame.rgb == first.stored_frame(f).frame.rgb for f in first.frames
    )


def test_folding_the_deltas_gives_the_map_at_any_step(path: Path) -> None:
    written = example_recording.write(path)
    recording = Recording.open(path)
    for step in range(10):
        past = [s.event.delta for s in written if s.step <= step and isinstance(s.event, GraphChanged)]
        try:
            expected = TopologicalGraph(past)
        except MapError:
            continue  # The scenario spreads events over steps so that some prefixes by step do not fit together.
        assert recording.graph_at(step) == expected
    assert recording.final_graph() == TopologicalGraph(
        s.event.delta for s in written if isinstance(s.event, GraphChanged)
    )


def test_arrays_may_be_changed_after_they_were_written(path: Path) -> None:
    reused = example_recording.observation(0)
    depth = reused.require_depth("the test")
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for step in range(20):
            fresh = example_recording.observation(step)
            for mine, theirs in (
                (reused.rgb, fresh.rgb),
                (depth, fresh.require_depth("the test")),
                (reused.odometry, fresh.odometry),
            ):
                mine[...] = theirs
            writer.write_frame(
                type(reused)(reused.rgb, reused.depth, reused.odometry, fresh.stamp, step, fresh.exact_pose)
            )
            depth[...], reused.odometry[...] = 9.0, 9.0
    recording = Recording.open(path)
    for step in recording.frames:
        assert np.array_equal(recording.observation(step).odometry, example_recording.observation(step).odometry)
        read, written = (each.observation(step).require_depth("the test") for each in (recording, example_recording))
        assert np.abs(read - written).max() < 0.001


def test_an_existing_file_is_never_overwritten(path: Path) -> None:
    example_recording.write(path)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="exists"):
        RecordingWriter(path, scene="demo", config={}, fingerprint="")
    assert path.read_bytes() == before


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(RecordingError, match="file"):
        RecordingWriter(tmp_path / "file" / "drive.rrd", scene="demo", config={}, fingerprint="")


def test_a_summary_counts_what_was_written(path: Path) -> None:
    example_recording.write(path)
    summary = read_info(path)
    assert (summary.frames, summary.nodes, summary.edges, summary.reserve) == (10, 3, 2, 3)
    assert (summary.queries, summary.whole, summary.scene, summary.fingerprint) == (1, True, "demo", "abc")
    assert summary.questions == {}


def test_questions_are_counted_also_after_a_repair_and_change_no_event(path: Path, tmp_path: Path) -> None:
    with RecordingWriter(path) as writer:
        for step, event in enumerate(example_recording.events()):
            writer.write_event(StampedEvent(step, step / 10, event))
        for word in ("edge", "wrong", "edge"):
            writer.write_question(word)
    repair(path, tmp_path / "repaired.rrd")
    assert read_info(path).questions == read_info(tmp_path / "repaired.rrd").questions == {"edge": 2, "wrong": 1}
    assert [each.event for each in Recording.open(path).events] == example_recording.events()


def test_a_map_returns_with_its_images(tmp_path: Path) -> None:
    graph = TopologicalGraph(event.delta for event in example_recording.events() if isinstance(event, GraphChanged))
    images = [example_recording.observation(step) for step in range(10)]
    save_map(tmp_path / "map.rrd", graph, images, scene="demo", fingerprint="abc", config={})
    loaded = load_map(tmp_path / "map.rrd")
    assert loaded.graph == graph
    assert sorted(loaded.observations) == [0, 1, 2, 3, 4, 8]
    verify(tmp_path / "map.rrd")


def test_a_map_without_all_its_images_is_not_saved(tmp_path: Path) -> None:
    graph = TopologicalGraph(event.delta for event in example_recording.events() if isinstance(event, GraphChanged))
    with pytest.raises(MapError, match="images are missing"):
        save_map(tmp_path / "map.rrd", graph, [], scene="demo", fingerprint="abc", config={})
    assert not list(tmp_path.iterdir())


def test_a_map_of_other_weights_is_refused(tmp_path: Path) -> None:
    graph = TopologicalGraph([d.NodeAdded(d.Node(0, d.PoseRow(0, 0, 0)), d.Cause.BUILD)])
    save_map(
        tmp_path / "map.rrd", graph, [example_recording.observation(0)], scene="demo", fingerprint="abc", config={}
    )
    with pytest.raises(MapError, match="ltvn build"):
        check_fingerprint(load_map(tmp_path / "map.rrd").meta, "xyz")


def test_a_recording_without_a_map_says_how_to_make_one(path: Path) -> None:
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        writer.write_frame(example_recording.observation(0))
    with pytest.raises(MapError, match="ltvn build"):
        load_map(path)


def test_a_recording_that_begins_with_a_map_stands_alone(tmp_path: Path) -> None:
    graph = TopologicalGraph(event.delta for event in example_recording.events() if isinstance(event, GraphChanged))
    with RecordingWriter(tmp_path / "run.rrd", scene="demo", config={}, fingerprint="abc") as writer:
        writer.write_map(graph, [example_recording.observation(step) for step in (0, 1, 2, 3, 4, 8)])
        writer.write_frame(example_recording.observation(20))
    assert load_map(tmp_path / "run.rrd").graph == graph


@pytest.mark.parametrize("depth", [None, np.zeros((72, 96), np.float32)], ids=["absent", "zero"])
def test_a_frame_without_depth_is_kept_among_the_others(path: Path, depth: np.ndarray | None) -> None:
    with RecordingWriter(path, scene="room", config={}, fingerprint="") as writer:
        for step in range(6):
            seen = example_recording.observation(step)
            writer.write_frame(replace(seen, depth=depth) if step == 3 else seen)
    recording = Recording.open(path)
    assert [recording.observation(frame).has_depth for frame in recording.frames] == [True] * 3 + [False] + [True] * 2


def test_a_recording_that_ended_leaves_no_threads_behind(tmp_path: Path) -> None:
    example_recording.write(tmp_path / "first.rrd")
    before = psutil.Process().num_threads()
    for number in range(5):
        example_recording.write(tmp_path / f"{number}.rrd")
    assert psutil.Process().num_threads() < before + 5


@pytest.mark.parametrize("folder", ["", "missing"])
def test_images_that_leave_memory_are_read_as_before(
    folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "drive.rrd"
    example_recording.write(path)
    kept = Recording.open(path)
    monkeypatch.setattr(mapped_batches, "PART_BYTES", 1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / folder))
    moved = Recording.open(path)
    assert moved.frames == kept.frames
    assert all(moved.is_intact(frame) for frame in kept.frames)
    assert_array_equal(moved.observation(3).rgb, kept.observation(3).rgb)
    assert_array_equal(moved.observation(3).depth, kept.observation(3).depth)


def test_a_recording_needs_no_more_than_a_path(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "drive.rrd") as writer:
        writer.log("my/score", 0.7, step=0, stamp=0.0)

    written = Recording.open(tmp_path / "drive.rrd")
    assert (written.meta.scene, written.meta.config, written.meta.fingerprint) == ("", {}, "")


def test_a_recording_has_its_timeline_at_hand() -> None:
    queries = Recording.open(DEMO_FAULT).timeline.queries

    assert [query.id for query in queries] == [0, 1, 2, 3]
    assert len(str(queries[0])) < 120
    assert "no path" in str(queries[3])
