"""Golden runs: the events of seeded queries with planar bodies, and the maps that are built from drives."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from ltvn_core.data.recording.event_codec import encode_event
from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Event
from ltvn_core.predictors.opening import NETWORK, open_method, open_predictor
from ltvn_core.simulation.opening import Simulation, open_script, open_simulation
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.systems.registry import OWN_SYSTEMS, system_entry
from ltvn_core.types import FrameId, NodeId, Pose
from tools.golden.answers import RECORDINGS
from tools.golden.files import Row, plain

NOISE = OdometryNoise(0.02, 0.01)
POSE_DIGITS = 6
_HALF_HOUR_S = 1800.0
_LEAST_M = 0.8
"""Least distance of a goal, in metres."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Queries in one scene with one system."""

    name: str
    queries: int
    scene: str = "demo"
    images: int = 0
    """Images of a mapping drive from which the map is built; 0 takes the shipped map of the demo apartment."""
    system: str = "ltvn"
    preset: str = "robust"
    world: str = "static"
    """Script of the scene's changes; half an hour passes before each query."""
    maintenance: str = ""
    """By default that of the system."""
    seed: int = 0
    most_m: float = 2.5
    """Greatest distance of a goal, in metres."""


SETTINGS = (
    Setting(name="demo map", queries=5),
    Setting(name="apartment", scene="apartment-57", images=90, queries=4),
    Setting(name="plain place", scene="plain-0", images=90, queries=3),
    Setting(name="doors", world="doors", maintenance="persistent", queries=6, seed=1, most_m=4.5),
    Setting(name="rival", system="sptm", images=90, queries=2, most_m=1.5),
)
MORE_SETTINGS = (
    *(Setting(name=f"rival {name}", system=name, images=400, queries=10, most_m=9) for name in OWN_SYSTEMS[1:]),
    Setting(name="paper", preset="paper", images=400, queries=10, most_m=9),
    Setting(name="large apartment", scene="apartment-124", images=600, queries=20, most_m=20),
    Setting(name="everything changes", world="all", maintenance="persistent", queries=20, most_m=9),
)


def maps(images: int | None, presets: Sequence[str]) -> Iterator[Row]:
    """Yield the nodes and edges of the maps of the shipped drive, or of its first images."""
    drive = Recording.open(RECORDINGS / "demo-drive.rrd")
    seen = [drive.observation(frame) for frame in drive.frames[:images]]
    for preset in presets:
        predictor = open_predictor()
        system = system_entry("ltvn").factory(open_method(preset, predictor))
        known = build_map(seen, predictor=predictor, system=system, scene="demo", camera=drive.meta.camera)
        yield Row(f"{preset}: reserve", sorted(known.graph.reserve))
        yield Row(f"{preset}: findings", [*known.doubts])
        for node in known.graph.nodes.values():
            yield Row(f"{preset}: node {node.id}", plain(node.odometry, POSE_DIGITS))
        for (source, target), edge in known.graph.edges.items():
            numbers = plain((*edge.waypoint, edge.belief.p, edge.belief.mu, edge.belief.sigma2), POSE_DIGITS)
            yield Row(f"{preset}: edge {source}->{target}", [*numbers, edge.by_odometry])


def runs(settings: Sequence[Setting]) -> Iterator[Row]:
    """Yield a row with all events of each query."""
    for setting in settings:
        known = _map(setting)
        yield Row(f"{setting.name}: map", _outline(known.graph))
        simulation = _simulation(setting, max(known.keyframes.frames) + 1)
        for query in range(setting.queries):
            yield _query(setting, known, simulation, query)
        simulation.robot.close()


def _map(setting: Setting) -> TopologicalMap:
    """Return the shipped map, or one of a short mapping drive."""
    if setting.images:
        entry = system_entry(setting.system)
        predictor = open_predictor(NETWORK, weights=entry.weights)
        simulation = _simulation(replace(setting, world="static"), 0)
        drive = drive_tour(simulation.robot, simulation.scene, np.random.default_rng(0), loops=3)
        system = entry.factory(open_method(setting.preset, predictor))
        known = build_map(islice(drive, setting.images), predictor=predictor, system=system, scene=setting.scene)
        simulation.robot.close()
    else:
        known = TopologicalMap.open(RECORDINGS / "demo-map.rrd", preset=setting.preset)
    if setting.maintenance:
        known = replace(known, system=with_maintenance(known.system, setting.maintenance))
    return known


def _simulation(setting: Setting, first_step: FrameId) -> Simulation:
    script = open_script(setting.world, setting.scene, seed=0)
    return open_simulation(
        setting.scene, seed=0, first_step=first_step, odometry_noise=NOISE, script=script, body="planar"
    )


def _outline(graph: TopologicalGraph) -> dict[str, Any]:
    return {"nodes": sorted(graph.nodes), "edges": [f"{source}->{target}" for source, target in sorted(graph.edges)]}


def _query(setting: Setting, known: TopologicalMap, simulation: Simulation, query: int) -> Row:
    """Drive from one node to another; queries share the map, but neither the robot's place nor random numbers."""
    events: list[Event] = []
    rng = np.random.default_rng([setting.seed, query])
    robot, world = simulation.robot, simulation.world
    world.follow(events.extend)
    if setting.world != "static":
        world.skip(_HALF_HOUR_S)
    start, goal = _ends(setting, known, simulation, rng)
    aim = _exact_pose(known, goal)
    robot.teleport(_exact_pose(known, start))
    navigator = known.navigator(robot, seed=rng, world_time=lambda: world.time_s)
    ended = navigator.drive_to(goal, query=query, consume=events.append)
    world.unfollow(events.extend)
    judged = judge_goal_reached(query, robot.exact_pose, aim)
    coded = tuple(plain(json.loads(encode_event(event))) for event in (*events, judged))
    return Row(f"{setting.name}: query {query} to {goal}", [str(ended.outcome), judged.reached], coded)


def _ends(
    setting: Setting, known: TopologicalMap, simulation: Simulation, rng: np.random.Generator
) -> tuple[NodeId, NodeId]:
    """Draw two nodes at which the robot can stand now, not farther from each other than the setting allows."""
    radius_m, clearance = simulation.robot.spec.radius_m, simulation.world.scene.clearance
    places = {node: _exact_pose(known, node)[:2] for node in sorted(known.graph.nodes)}
    free = [node for node, place in places.items() if clearance.at(place) >= radius_m]
    start = free[int(rng.integers(len(free)))]
    away_m = {node: float(np.hypot(*(places[node] - places[start]))) for node in free}
    near = [node for node in free if _LEAST_M < away_m[node] < setting.most_m]
    return start, near[int(rng.integers(len(near)))]


def _exact_pose(known: TopologicalMap, node: NodeId) -> Pose:
    pose = known.keyframes.observation(node).exact_pose
    assert pose is not None
    return pose
