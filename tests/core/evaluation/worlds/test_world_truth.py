"""What the world knows of a map in a real flat: which doors a query met closed, and the rooms of images."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.worlds.world_truth import ClosedEdges, DoorWatch, true_rooms
from ltvn_core.graph.deltas import Cause, PoseRow, PresenceObserved
from ltvn_core.navigation.events import AttemptStarted, GraphChanged
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Observation
from ltvn_core.worlds import DoorMoved
from tests.core.flat_world import observation_at

DOOR = 0


def nowhere(_: int) -> Observation:
    raise AssertionError("All poses are given.")


@pytest.mark.parametrize(("is_open", "met"), [(False, {DOOR}), (True, set())])
@pytest.mark.parametrize("by_sight", [True, False])
def test_a_door_is_met_closed_by_a_try_and_by_sight(is_open: bool, met: set[int], by_sight: bool) -> None:
    scene = load_scene("demo")
    door = scene.parts.doors[DOOR]
    across = np.array([0.8, 0.0] if door.axis == 0 else [0.0, 0.8])
    ends = [np.array([*(door.middle + side * across), 0.0]) for side in (-1, 1)]
    truth = GroundTruth(scene.clearance, nowhere, poses=dict(enumerate(ends)))
    world = World(scene)
    world.apply(DoorMoved(DOOR, is_open=is_open))
    watch = DoorWatch(world, ClosedEdges(scene, truth))
    if by_sight:
        seen = PresenceObserved(0, 1, present=False, stamp=0.0, cause=Cause.SIGHT)
        watch.consume(GraphChanged(seen, 0, None))
    else:
        watch.consume(AttemptStarted(0, 1, 0, 1, 0, PoseRow(1.6, 0.0, 0.0), 0.9))
    assert watch.met_closed == met
    assert watch.blocked_tries == watch.door_tries == (not is_open and not by_sight)


def test_each_image_lies_in_the_room_that_it_was_taken_in() -> None:
    scene = load_scene("demo")
    centres = [((room.x0 + room.x1) / 2, (room.y0 + room.y1) / 2) for room in scene.rooms]
    seen = [observation_at(np.array([*xy, 0.5]), k) for k, xy in enumerate([*centres, (-50.0, 0.0)])]
    room_of = true_rooms(scene, lambda frame: seen[frame])
    assert [room_of(k) for k in range(len(seen))] == [*range(len(scene.rooms)), None]
