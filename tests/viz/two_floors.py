"""A flat world whose two rooms are two floors: only a lift leads from one to the other."""

from pathlib import Path

import numpy as np

from ltvn_core.analysis.manual_edits import connect_by_action
from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.types import NodeId
from ltvn_viz.wishes import commands as c
from tests.browser.flat_app import WAY
from tests.core.flat_world import two_rooms
from tests.viz.session_harness import SessionHarness

WALL_M = 3.0
"""Position of the wall between the rooms along x, in metres."""
LIFT = "Take the lift to floor 2"


def open_two_rooms(folder: Path) -> SessionHarness:
    """Return a session with a map of both rooms, between which no edge leads; the robot stands in the first."""
    harness = SessionHarness(folder, world=two_rooms(), way=WAY)
    harness.do(split_rooms(harness))
    return harness


def split_rooms(harness: SessionHarness) -> c.EditMap:
    """Return the command that removes all edges between the rooms."""
    graph = harness.state.live_map.graph
    between = [key for key in graph.edges if len({is_in_first_room(harness, node) for node in key}) == 2]
    return c.EditMap(tuple(EdgePruned(*key, Cause.HAND) for key in between))


def add_lift(harness: SessionHarness) -> c.EditMap:
    """Return the command that joins the rooms by a lift, in one direction."""
    return c.EditMap(connect_by_action(harness.state.live_map.graph, *lift_ends(harness), LIFT))


def lift_ends(harness: SessionHarness) -> tuple[NodeId, NodeId]:
    """Return the node in front of the lift in the first room, and the one in the second."""
    return nearest(harness, 2.2, 2.0), nearest(harness, 3.8, 2.0)


def nearest(harness: SessionHarness, x: float, y: float) -> NodeId:
    """Return the node nearest to a place, in metres."""
    graph = harness.state.live_map.graph
    return min(graph.nodes, key=lambda node: float(np.hypot(*(_pose(harness, node)[:2] - (x, y)))))


def is_in_first_room(harness: SessionHarness, node: NodeId) -> bool:
    """Tell whether a node is in the first room."""
    return bool(_pose(harness, node)[0] < WALL_M)


def _pose(harness: SessionHarness, node: NodeId) -> np.ndarray:
    pose = harness.state.live_map.keyframes.observation(node).exact_pose
    assert pose is not None
    return pose
