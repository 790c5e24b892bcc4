"""What a recording holds for Rerun's viewer and dataframes beside its frames: beliefs, events, images, own rows."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
import trimesh
from rerun.chunk import RrdReader

from ltvn_core.data.recording.drawn_poses import FloorExtent
from ltvn_core.data.recording.excerpt import write_excerpt
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.data.recording.schema import read_cell
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, EdgePruned, GraphDelta, PoseRow
from ltvn_core.navigation.events import (
    AttemptStarted,
    Event,
    GraphChanged,
    Localised,
    Planned,
    QueryStarted,
    StampedEvent,
)
from ltvn_core.simulation.scene_registry import load_scene
from tests.core.data.recording import example_recording
from tests.core.graph.small_maps import edge_added, node_added

EDGES = 100


def rows(path: Path, entity: str, column: str, timeline: str) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the place on a timeline and the numbers of each row of an entity, in the order of the timeline."""
    found = []
    for chunk in RrdReader(path).stream().filter(content=entity, has_timeline=timeline):
        batch = chunk.to_record_batch()
        if column in batch.schema.names:
            steps = batch.column(timeline).to_pylist()
            found += [(step, read_cell(batch.column(column), k)) for k, step in enumerate(steps)]
    yield from sorted(found, key=lambda row: row[0])


def entities(path: Path) -> set[str]:
    return {str(chunk.entity_path) for chunk in RrdReader(path).stream()}


def write(path: Path, events: Sequence[Event], *, frames: Sequence[int] = (), steps: int = 1) -> None:
    """Write events, `steps` of them to each control step."""
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for step in frames:
            writer.write_frame(example_recording.observation(step))
        for number, event in enumerate(events):
            writer.write_event(StampedEvent(number // steps, number / 10, event))


def chain(length: int) -> list[GraphDelta]:
    """Return the deltas of a map whose nodes 0, 1, 2 ... follow each other."""
    nodes = range(length + 1)
    return [
        *(node_added(k, float(k)) for k in nodes),
        *(edge_added(a, b, p=0.5, sigma2=0.04) for a, b in pairwise(nodes)),
    ]


def test_every_edge_that_changes_has_its_p_mu_and_sigma_over_time(tmp_path: Path) -> None:
    path = tmp_path / "many.rrd"
    updates = [BeliefUpdated(k, k + 1, Belief(0.9, 1.5, 0.09), 1, 1, Cause.ATTEMPT) for k in range(EDGES)]
    pruned = EdgePruned(EDGES - 1, EDGES, Cause.ATTEMPT)
    write(path, [GraphChanged(delta) for delta in (*chain(EDGES), *updates, pruned)])
    for k in range(EDGES):
        last = [0.0] if k == EDGES - 1 else []
        p = [row[0] for _, row in rows(path, f"/beliefs/p/{k}_{k + 1}", "Scalars:scalars", "step")]
        assert p == [0.5, 0.9, *last]
        length = [row for _, row in rows(path, f"/beliefs/length/{k}_{k + 1}", "Scalars:scalars", "step")]
        assert np.allclose(length[:2], [[1.0, 0.2], [1.5, 0.3]])


def test_an_edge_of_a_plan_has_a_curve_before_it_is_driven_and_one_that_nobody_drives_has_none(tmp_path: Path) -> None:
    path = tmp_path / "planned.rrd"
    write(path, [*map(GraphChanged, chain(4)), Planned(0, (1, 2, 3), 2.0)])
    curves = {name for name in entities(path) if name.startswith("/beliefs/p/")}
    assert curves == {"/beliefs/p/1_2", "/beliefs/p/2_3"}
    assert [row[0] for _, row in rows(path, "/beliefs/p/1_2", "Scalars:scalars", "step")] == [0.5]


def test_an_edge_that_comes_back_after_pruning_goes_on_with_its_curve(tmp_path: Path) -> None:
    path = tmp_path / "back.rrd"
    back = edge_added(0, 1, p=0.7, sigma2=0.04, cause=Cause.EXPAND)
    write(path, [GraphChanged(delta) for delta in (*chain(1), EdgePruned(0, 1, Cause.ATTEMPT), back)])
    assert [row[0] for _, row in rows(path, "/beliefs/p/0_1", "Scalars:scalars", "step")] == [0.5, 0.0, 0.7]


def test_all_events_are_there_by_their_own_timeline_though_they_share_steps(tmp_path: Path) -> None:
    path = tmp_path / "events.rrd"
    events = [GraphChanged(delta) for delta in chain(20)]
    write(path, events, steps=10)
    numbers = [row[0] for _, row in rows(path, "/events", "ltvn.Event:sequence", "event")]
    assert numbers == list(range(len(events)))
    assert [at for at, _ in rows(path, "/events", "ltvn.Event:sequence", "event")] == numbers
    assert len(Recording.open(path).events) == len(events)


def test_the_images_of_goal_subgoal_and_node_are_shown_when_they_are_named(tmp_path: Path) -> None:
    path = tmp_path / "images.rrd"
    started = AttemptStarted(0, 0, 1, 2, 1, PoseRow(1.0, 0.0, 0.0), 0.9)
    localised = Localised(0, 1, 1, 0.1, 0.9, None, math.inf, "global")
    write(path, [*map(GraphChanged, chain(3)), QueryStarted(0, 3), localised, started], frames=range(4))
    recording = Recording.open(path)
    for entity, node in (("goal", 3), ("node", 1), ("subgoal", 2)):
        ((_, jpeg),) = rows(path, f"/images/{entity}", "EncodedImage:blob", "step")
        shown = cv2.imdecode(jpeg, cv2.IMREAD_COLOR_RGB)
        assert shown is not None
        assert np.array_equal(shown, recording.observation(node).rgb)


def test_own_rows_are_written_beside_the_recorders(tmp_path: Path) -> None:
    path = tmp_path / "own.rrd"
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        writer.write_frame(example_recording.observation(7))
        writer.log("score", 0.25)
        writer.log("score", 0.75, step=9, stamp=0.9)
        writer.log("world/landmarks", rr.Points3D([[1.0, 2.0, 0.0]]))
    assert [(at, row[0]) for at, row in rows(path, "/score", "Scalars:scalars", "step")] == [(7, 0.25), (9, 0.75)]
    assert "/world/landmarks" in entities(path)


@pytest.mark.parametrize("entity", ["events", "/world/robot/camera/rgb", "world", "world/graph/mine", "", "beliefs/p"])
def test_own_rows_never_go_where_the_recorder_writes(tmp_path: Path, entity: str) -> None:
    with RecordingWriter(tmp_path / "own.rrd", scene="demo", config={}, fingerprint="") as writer:
        with pytest.raises(RecordingError, match="another path"):
            writer.log(entity, 1.0)
        with pytest.raises(RecordingError, match="number"):
            writer.log("mine")


def test_the_extent_of_a_scene_is_that_of_its_walls() -> None:
    glb = load_scene("demo").glb()
    extent = FloorExtent.of_glb(glb)
    assert extent is not None
    low, high = trimesh.load_scene(trimesh.util.wrap_as_stream(glb), file_type="glb").bounds
    assert np.allclose([*extent.low, *extent.high, extent.top_m], [*low[:2], *high[:2], high[2]], atol=1e-3)
    assert FloorExtent.of_glb(b"no scene") is None
    assert FloorExtent.of_glb(glb[:100]) is None


def test_own_rows_come_back_from_a_cut_recording_and_travel_with_an_excerpt(tmp_path: Path) -> None:
    path, cut = tmp_path / "own.rrd", tmp_path / "cut.rrd"
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        for step in range(20):
            writer.write_frame(example_recording.observation(step))
            writer.log("score", float(step))
        writer.log("world/landmarks", rr.Points3D([[1.0, 2.0, 0.0]]))
    verify(path)
    cut.write_bytes(path.read_bytes()[: check_file(path).whole_bytes])
    repair(cut, tmp_path / "mended.rrd")
    write_excerpt(Recording.open(path), tmp_path / "excerpt.rrd", from_s=0.5, to_s=0.9)
    for name, steps in (("own", range(20)), ("mended", range(20)), ("excerpt", range(5, 10))):
        found = rows(tmp_path / f"{name}.rrd", "/score", "Scalars:scalars", "step")
        assert [(at, row[0]) for at, row in found] == [(step, float(step)) for step in steps], name
        verify(tmp_path / f"{name}.rrd")
    assert "/world/landmarks" in entities(tmp_path / "mended.rrd")
