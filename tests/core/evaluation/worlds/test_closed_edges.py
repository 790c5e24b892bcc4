"""Which doors a query met closed, in a real flat."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.worlds.closed_edges import ClosedEdges, DoorWatch
from ltvn_core.graph.deltas import Cause, PoseRow, PresenceObserved
from ltvn_core.navigation.events import AttemptStarted, GraphChanged
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Observation
from ltvn_core.worlds.world_change import DoorMoved

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
