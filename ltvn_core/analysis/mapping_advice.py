"""The collect coach: what the map still lacks while somebody drives, and where to drive next.

Owns the order in which gaps are worth mending, and the words. Finding them is `analysis.coverage`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.analysis.mapping_gaps import (
    MissingLoopClosure,
    OneSidedPlace,
    find_missing_loop_closures,
    one_sided_places,
)
from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Pose

_KNOWN = 0.5
"""A view whose best r is above this shows nothing new."""
_AHEAD_M = 1.0
_STRAY = 2
"""A component with fewer nodes is not worth a trip."""
_HERE_M = 0.5


@dataclass(frozen=True, slots=True)
class DrivingHint:
    """Where to drive next."""

    text: str
    """One sentence."""
    target: PoseRow | None
    """A pose in the odometry frame; None where any direction is as good."""


@dataclass(frozen=True, slots=True)
class MappingAdvice:
    """The state of a map that is being collected."""

    strongly_connected_components: tuple[tuple[NodeId, ...], ...]
    """The largest first; one is what one wants."""
    missing_closures: tuple[MissingLoopClosure, ...]
    """Places visited twice with nothing across."""
    one_sided_places: tuple[OneSidedPlace, ...]
    """Places seen from one side only."""
    novelty: float | None
    """1 - best r of the current view to any node: 0 = known, 1 = new; None where nobody compared it."""
    hint: DrivingHint


def advise_mapping(
    graph: TopologicalGraph, steps: Sequence[FrameId], poses: Pose, current: Matches | None = None
) -> MappingAdvice:
    """Return what the map lacks so far and one hint where to drive next.

    `steps` (T,) and odometry `poses` (T, 3) are the drive so far, ascending, its last pose the present one. `current`
    is the present view against the nodes, as `Matcher.match` gives it: the one cost that is not arithmetic. The rest is
    linear in images, nodes and edges.
    """
    poses = np.asarray(poses, np.float64).reshape(-1, 3)
    components = strongly_connected_components(graph)
    missing_closures = find_missing_loop_closures(graph, steps, poses)
    places = one_sided_places(poses)
    novelty = None if current is None else 1 - float(np.max(current.reachability, initial=0.0))
    return MappingAdvice(
        strongly_connected_components=components,
        missing_closures=missing_closures,
        one_sided_places=places,
        novelty=novelty,
        hint=_hint(
            graph, poses, components=components, missing_closures=missing_closures, places=places, novelty=novelty
        ),
    )


def _hint(
    graph: TopologicalGraph,
    poses: Pose,
    *,
    components: tuple[tuple[NodeId, ...], ...],
    missing_closures: tuple[MissingLoopClosure, ...],
    places: tuple[OneSidedPlace, ...],
    novelty: float | None,
) -> DrivingHint:
    """Choose what to mend: first what makes goals unreachable, last what makes the map richer."""
    if not len(poses):
        return DrivingHint("Drive a little, so that there is something to see.", None)
    here = poses[-1]
    hints = (
        _join(graph, here, components),
        _close(graph, here, missing_closures),
        _go_on(here, novelty),
        _turn_round(here, places),
    )
    return next((hint for hint in hints if hint is not None), _elsewhere(here, poses))


def _join(graph: TopologicalGraph, here: Pose, components: Sequence[Sequence[NodeId]]) -> DrivingHint | None:
    """Lead to the nearest node of a component in which the robot is not."""
    worth = [component for component in components if len(component) >= _STRAY]
    if len(worth) < 2:
        return None
    nearest = [min((_apart(graph, here, node), node) for node in component) for component in worth]
    gap, node = sorted(nearest)[1]
    target = graph.nodes[node].odometry
    way = "drive from there back to where you are" if gap < _HERE_M else f"drive to node {node}, {_way(here, target)}"
    return DrivingHint(
        f"The map is in {len(worth)} pieces: {way}, and look ahead on the way, so that they join.", target
    )


def _close(graph: TopologicalGraph, here: Pose, missing_closures: Sequence[MissingLoopClosure]) -> DrivingHint | None:
    """Lead to the nearest place where a loop is open."""
    if not missing_closures:
        return None
    loop = min(missing_closures, key=lambda each: _apart(graph, here, each.first))
    target = graph.nodes[loop.first].odometry
    return DrivingHint(
        f"Nodes {loop.first} and {loop.second} are the same place on two visits, but no edge joins them: drive through "
        f"it again, {_way(here, target)}.",
        target,
    )


def _turn_round(here: Pose, sides: Sequence[OneSidedPlace]) -> DrivingHint | None:
    """Lead to the nearest place that was seen from one side only, to look the other way."""
    if not sides:
        return None
    place = min(sides, key=lambda each: math.hypot(each.x_m - here[0], each.y_m - here[1]))
    target = PoseRow(place.x_m, place.y_m, float(wrap_angle(place.yaw_rad + math.pi)))
    return DrivingHint(
        f"One place was seen from one side only: look the other way there, {_way(here, target)}.", target
    )


def _go_on(here: Pose, novelty: float | None) -> DrivingHint | None:
    """Let the robot go on where everything is new."""
    if novelty is None or 1 - novelty > _KNOWN:
        return None
    target = here + np.array([_AHEAD_M * np.cos(here[2]), _AHEAD_M * np.sin(here[2]), 0.0])
    return DrivingHint(
        "This view is new: go on slowly, so that the next pictures join it to the map.", pose_row(target)
    )


def _elsewhere(here: Pose, poses: Pose) -> DrivingHint:
    """Lead to the rim of what was driven, where something new is likeliest."""
    middle = poses[:, :2].mean(axis=0)
    rim = poses[int(np.argmax(np.hypot(*(poses[:, :2] - middle).T)))]
    target = PoseRow(float(rim[0]), float(rim[1]), float(np.arctan2(*(rim[:2] - middle)[::-1])))
    return DrivingHint(f"All is well here: go beyond the rim of what you have seen, {_way(here, target)}.", target)


def _apart(graph: TopologicalGraph, here: Pose, node: NodeId) -> float:
    x, y, _ = graph.nodes[node].odometry
    return math.hypot(x - here[0], y - here[1])


def _way(here: Pose, target: PoseRow) -> str:
    """Say where a pose is, as seen from here."""
    dx, dy, _ = (float(value) for value in relative(here, np.array(target)))
    away = math.hypot(dx, dy)
    if away < _HERE_M:
        return "right where you are"
    bearing = math.degrees(math.atan2(dy, dx))
    side = "to the left" if bearing > 0 else "to the right"
    if abs(bearing) < 25:
        side = "straight ahead"
    elif abs(bearing) > 155:
        side = "behind you"
    return f"{away:.1f} m away {side}"
