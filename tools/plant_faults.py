"""Write a recording with faults to find: `python -m tools.plant_faults MAP.rrd FAULTS.rrd`.

Puts faults into a correct map of a simulated scene, and drives a query that meets each of them: a spurious edge, an
edge between perceptual aliases, missing edges. The ground truth determines their places. The map's reserve is left out,
so that maintenance cannot repair the map with it.
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from ltvn_core.config import BeliefConfig
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.recorded_run import RunDescription
from ltvn_core.errors import MapError
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.geometry import distance, invert, relative
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, EdgePruned, FramesReleased, GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import initial_belief, pose_row
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.opening import open_method
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems.registry import recorded_system
from ltvn_core.types import NodeId, Pose, Predictor, Waypoint
from ltvn_core.verbs.headless_runner import HeadlessRunner
from ltvn_core.verbs.robot_queries import QueriesSummary

THROUGH_WALL_M = 2.5
"""Greatest length of a spurious edge, in metres; such an edge is spurious only because of the wall."""
DETOUR_M = 3.5
"""Least length of the true path around the wall, in metres."""
ALIAS_DISTANCE_M = 3.0
"""Least distance between two places that are perceptual aliases, in metres."""
QUERY_STEPS = 80
"""Control steps of 0.1 s after which a query ends."""
_ENDPOINT_MARGIN_M = 2.0
"""Distance that a cut keeps from the start and goal of the query."""
_BATCH = 4096


class FaultKind(StrEnum):
    """The kind of a fault; its value is stored in recordings."""

    SPURIOUS_EDGE = "spurious-edge"
    """An edge through a wall with a high p."""
    PERCEPTUAL_ALIAS = "look-alike"
    """An edge between two distant places that the network predicts to be close."""
    MISSING_EDGE = "missing-edge"
    """No edge where there was a passage, so that the map is in two parts."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault and a query that meets it."""

    kind: FaultKind
    edges: tuple[EdgeKey, ...]
    """Edges that are added or removed."""
    deltas: tuple[GraphDelta, ...]
    """Deltas that inject the fault."""
    start: NodeId
    """Node at which the robot starts."""
    goal: NodeId


@dataclass(frozen=True)
class PlantedFaults:
    """The faults of a recording, and the results of the queries that met them."""

    faults: tuple[Fault, ...]
    """The faults, one for each query."""
    outcome: QueriesSummary


DEMO_FAULTS = (
    FaultKind.SPURIOUS_EDGE,
    FaultKind.SPURIOUS_EDGE,
    FaultKind.PERCEPTUAL_ALIAS,
    FaultKind.MISSING_EDGE,
)
"""The faults of the demo recording in the order of its queries; the first is met twice."""


def missing_edge(graph: TopologicalGraph, truth: GroundTruth) -> Fault:
    """Remove the minimum cut between the two nodes that are farthest apart, as if a passage was never mapped.

    Raises MapError if every cut is too close to the start or the goal.
    """
    nodes = list(graph.nodes)
    places = truth.poses(nodes)[:, :2]
    start = int(np.hypot(*(places - places.mean(axis=0)).T).argmax())
    goal = int(np.hypot(*(places - places[start]).T).argmax())
    side = _start_side_of_cut(graph, nodes, places, start, goal)
    edges = tuple(key for key in graph.edges if (key[0] in side) != (key[1] in side))
    if not edges or any({nodes[start], nodes[goal]} & set(key) for key in edges):
        raise MapError("This map has no passage that could be cut; choose a larger one.")
    cuts = tuple(EdgePruned(*key, Cause.LOAD) for key in edges)
    return Fault(kind=FaultKind.MISSING_EDGE, edges=edges, deltas=cuts, start=nodes[start], goal=nodes[goal])


def spurious_edge(
    graph: TopologicalGraph, truth: GroundTruth, config: BeliefConfig, *, detour_m: float = DETOUR_M
) -> Fault:
    """Connect two nodes with similar headings and a wall between them: the pair with the longest true path.

    Both nodes are in one component of the map. Raises MapError if no true path is longer than `detour_m`.
    """
    nodes = list(graph.nodes)
    poses = truth.poses(nodes)
    pairs = _hidden_pairs(truth, poses, _components(graph), detour_m)
    row, other, _ = max(pairs, key=lambda pair: pair[2], default=(0, 0, 0.0))
    if row == other:
        raise MapError("This map has no nodes with a wall between them and a long route around it; choose another one.")
    waypoint = relative(poses[row], poses[other])
    return _fault_of_edge(FaultKind.SPURIOUS_EDGE, nodes[row], nodes[other], waypoint, config.p_cap, config)


def _hidden_pairs(
    truth: GroundTruth, poses: Pose, pieces: NDArray[np.intp], detour_m: float
) -> Iterator[tuple[int, int, float]]:
    """Yield two rows of `poses` (N, 3) with a wall between them, and the length of the true path if it exceeds
    `detour_m`."""
    for row, pose in enumerate(poses):
        ahead = _is_ahead(relative(pose, poses))
        hidden = ahead & (truth.clearance.along(np.broadcast_to(pose[:2], (len(poses), 2)), poses[:, :2]) <= 0)
        rows = np.flatnonzero(hidden & (pieces == pieces[row]))
        ways_m = truth.clearance.path_lengths(pose, poses[rows, :2])
        for other, way_m in zip(rows.tolist(), ways_m.tolist(), strict=True):
            if np.isfinite(way_m) and way_m > detour_m:
                yield row, other, way_m


def perceptual_alias(
    graph: TopologicalGraph,
    truth: GroundTruth,
    keyframes: KeyframeStore,
    predictor: Predictor,
    config: BeliefConfig,
    near: float,
) -> Fault:
    """Connect the two distant nodes, in one component of the map, with the highest predicted r and d < `near`.

    Compares all pairs; 327 nodes take ten seconds. Raises MapError if there is no such pair.
    """
    nodes = list(graph.nodes)
    poses = truth.poses(nodes)
    features = keyframes.features(nodes)
    first, second = _far_pairs(poses, _components(graph))
    best = None
    surest = 0.0
    for begin in range(0, len(first), _BATCH):
        i = first[begin : begin + _BATCH]
        j = second[begin : begin + _BATCH]
        predicted = predictor.predict(features[i], features[j])
        candidate = (distance(predicted.waypoints) < near) & (predicted.waypoints[:, 0] > 0)
        score = np.where(candidate, predicted.reachability, 0.0)
        top = int(score.argmax())
        if score[top] > surest:
            best = (int(i[top]), int(j[top]), predicted.waypoints[top])
            surest = float(score[top])
    if best is None:
        raise MapError("The network finds no perceptual aliases in this map; choose another map or other weights.")
    return _fault_of_edge(FaultKind.PERCEPTUAL_ALIAS, nodes[best[0]], nodes[best[1]], best[2], surest, config)


def _fault_of_edge(
    kind: FaultKind, source: NodeId, target: NodeId, waypoint: Waypoint, p: float, config: BeliefConfig
) -> Fault:
    belief = initial_belief(p, float(distance(waypoint)), config)
    there = Edge(source=source, target=target, waypoint=pose_row(waypoint), belief=belief)
    back = Edge(source=target, target=source, waypoint=pose_row(invert(waypoint)), belief=belief)
    deltas = EdgeAdded(there, Cause.LOAD), EdgeAdded(back, Cause.LOAD)
    return Fault(kind=kind, edges=((source, target), (target, source)), deltas=deltas, start=source, goal=target)


def _is_ahead(waypoints: Waypoint) -> NDArray[np.bool_]:
    """Return which targets (N, 3) are ahead, close, and have a similar heading."""
    dx, dy, dtheta = waypoints.T
    return (dx > 0.5) & (np.hypot(dx, dy) < THROUGH_WALL_M) & (np.abs(dy) < dx) & (np.abs(dtheta) < 1.0)


def _components(graph: TopologicalGraph) -> NDArray[np.intp]:
    """Return the component of the map (N,) of each node; a fault between two components would hide a missing edge."""
    row = {node: k for k, node in enumerate(graph.nodes)}
    ends = np.array([(row[source], row[target]) for source, target in graph.edges], np.intp).reshape(-1, 2)
    joined = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (len(row), len(row)))
    return connected_components(joined, directed=False)[1]


def _far_pairs(poses: Pose, pieces: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    gaps = poses[:, None, :2] - poses[None, :, :2]
    far = (np.hypot(gaps[..., 0], gaps[..., 1]) > ALIAS_DISTANCE_M) & (pieces[:, None] == pieces[None, :])
    first, second = np.nonzero(far)
    return first, second


def _start_side_of_cut(
    graph: TopologicalGraph, nodes: Sequence[NodeId], places: NDArray[np.float64], start: int, goal: int
) -> set[NodeId]:
    """Return the nodes on the start's side of the minimum cut that keeps a distance from start and goal."""
    row = {node: k for k, node in enumerate(nodes)}
    both_ways = {*graph.edges, *((target, source) for source, target in graph.edges)}
    ends = np.array([(row[source], row[target]) for source, target in both_ways], np.intp).reshape(-1, 2)
    close = np.minimum(*(np.hypot(*(places - places[k]).T) for k in (start, goal))) < _ENDPOINT_MARGIN_M
    # Edges near start and goal are too expensive to cut.
    room = np.where(close[ends].any(axis=1), len(ends), 1).astype(np.int32)
    capacity = csr_array((room, (ends[:, 0], ends[:, 1])), (len(nodes), len(nodes)))
    left = capacity - maximum_flow(capacity, start, goal).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = breadth_first_order(left, start, return_predecessors=False)
    return {nodes[k] for k in reached.tolist()}


def plant_faults(path: Path, output: Path, kinds: Sequence[FaultKind] = DEMO_FAULTS) -> PlantedFaults:
    """Put faults into a map, and record a query that meets each of them. Raises MapError and RecordingError."""
    loaded = load_map(path)
    graph = loaded.graph
    opened = TopologicalMap.open(loaded, with_reserve=False)
    method = open_method("robust", opened.predictor)
    # The robot gives up early.
    method = replace(method, recovering=replace(method.recovering, step_limit=QUERY_STEPS, give_up_after_looks=12))
    known = replace(opened, system=recorded_system(loaded.meta.config).factory(method))
    faults = _insert_faults(
        known, GroundTruth(load_scene(known.scene).clearance, loaded.observations.__getitem__), kinds
    )
    start = loaded.observations[faults[0].start].exact_pose
    simulation = open_simulation(known.scene, seed=0, first_step=max(loaded.observations) + 1, start=start, body="auto")
    run = RunDescription(
        scene=known.scene,
        config=_settings(known, faults) | {"body": choose_body("auto")},
        fingerprint=known.predictor.fingerprint,
        scene_glb=simulation.scene.glb(),
    )
    with run.open_writer(output) as writer:
        writer.write_map(graph, known.observations)
        runner = HeadlessRunner(simulation, writer, known)
        goals, starts = [fault.goal for fault in faults], [fault.start for fault in faults]
        outcome = runner.run_queries(goals, np.random.default_rng(0), starts=starts)
    return PlantedFaults(faults, outcome)


def _insert_faults(known: TopologicalMap, truth: GroundTruth, kinds: Sequence[FaultKind]) -> tuple[Fault, ...]:
    """Put the faults into the map; missing edges come first, so that no other fault joins the separated parts."""
    graph = known.graph
    belief = known.system.method.believing
    near = known.system.method.building.connect_distance
    graph.apply(FramesReleased(tuple(graph.reserve), Cause.LOAD))
    makers: dict[FaultKind, Callable[[], Fault]] = {
        FaultKind.MISSING_EDGE: lambda: missing_edge(graph, truth),
        FaultKind.SPURIOUS_EDGE: lambda: spurious_edge(graph, truth, belief),
        FaultKind.PERCEPTUAL_ALIAS: lambda: perceptual_alias(
            graph, truth, known.keyframes, known.predictor, belief, near
        ),
    }
    faults: dict[FaultKind, Fault] = {}
    for kind, make in makers.items():
        if kind in kinds:
            faults[kind] = make()
            for delta in faults[kind].deltas:
                graph.apply(delta)
    return tuple(faults[kind] for kind in kinds)


def _settings(known: TopologicalMap, faults: Sequence[Fault]) -> dict[str, Any]:
    """Return the settings of the recording, with the faults to find in it."""
    said = [
        {"kind": fault.kind, "query": query, "start": fault.start, "goal": fault.goal, "edges": fault.edges}
        for query, fault in enumerate(faults)
    ]
    return {
        "system": known.system.name,
        "seed": 0,
        "predictor": known.predictor_name,
        "method": asdict(known.system.method),
        "faults": said,
    }


def main() -> int:
    """Parse the command line and write one recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    planted = plant_faults(options.map, options.output)
    for query, fault in enumerate(planted.faults):
        sys.stdout.write(f"query {query}: {fault.kind} {fault.edges}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
