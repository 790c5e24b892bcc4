"""Drives the scheduled queries in a changing world, and judges each by the state of the world at its time.

All maintenances get the same queries, and each maintenance has its own map.
"""

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ltvn_core.evaluation.encounters import EncounterLog, count_encounters
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.plans import RunFiles, open_planned_system
from ltvn_core.evaluation.query_result import PresenceBin, PresenceScore, QueryResult
from ltvn_core.evaluation.results import load_results
from ltvn_core.evaluation.worlds.world_schedule import LATER_S, ScheduledQuery, WorldSchedule
from ltvn_core.evaluation.worlds.world_truth import ClosedEdges, DoorWatch, true_presence, true_rooms
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Event
from ltvn_core.network.metrics import calibration_table
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.types import Pose, Predictor


class WorldDrive:
    """A map after some queries, in the world at the time of the next query."""

    def __init__(self, files: RunFiles, first: int) -> None:
        """Load the map after `first` queries, with its scene and network."""
        self._plan = plan = files.plan
        self._schedule: WorldSchedule = load_results(files.world_queries, WorldSchedule)
        self._changing = self._schedule.changing
        scene = load_scene(plan.scene)
        self.world = World(scene, plan.script(scene), start_s=self._schedule.queries[first].at_s)
        predictor = open_predictor(plan.predictor, plan.scene, files.weights, device=plan.device)
        _keep_informed(predictor, self.world)
        system = open_planned_system(replace(plan, maintenance=None), predictor, scene, maintain=True)
        known = TopologicalMap.load(files.map(first), predictor, system=system)
        truth = true_presence(self.world, known.keyframes.observation)
        room_of = true_rooms(scene, known.keyframes.observation)
        maintenance = plan.maintenance or plan.preset
        known = replace(known, system=with_maintenance(system, maintenance, truth=truth, room_of=room_of))
        self.runner = EpisodeRunner(scene, known, plan.protocol, world=self.world)
        self.closed_edges = ClosedEdges(scene, self.runner.truth)

    def run(self, query: int) -> QueryResult:
        """Let time pass until the start of a query, and drive the query."""
        runner = self.runner
        world = self.world
        graph = runner.map.graph
        scheduled = self._schedule.queries[query]
        at_s = scheduled.at_s
        if at_s > world.time_s:
            world.skip(at_s - world.time_s)
        foretell = partial(score_presence, runner.map.system, graph, edges=self._changing)
        now = foretell(at_s=at_s, closed=scheduled.closed)
        later = foretell(at_s=at_s + LATER_S, closed=scheduled.closed_later)
        doors_wanted = self._doors_wanted(scheduled)
        watch = DoorWatch(world, self.closed_edges)
        people = EncounterLog()
        end: Pose = np.array(scheduled.episode.start_pose)

        def consume(event: Event, robot: SimulatedRobot) -> None:
            nonlocal end
            end = robot.exact_pose
            watch.consume(event)

        # Changes of the world also begin new steps, so a query takes more images than steps.
        steps = self._plan.protocol.steps_in(runner.scene)
        result = runner.run(
            query,
            scheduled.episode,
            np.random.default_rng([self._plan.seed, 8, query]),
            on_event=consume,
            first_frame=self._schedule.first_frame + query * 4 * (steps + 1),
            on_step=people.watch,
        )
        goal = np.array([scheduled.episode.goal_pose])
        return replace(
            result,
            at_s=at_s,
            cut_off=not result.reached and not bool(world.reachable(end, goal)[0]),
            shortest_m=scheduled.shortest_m,
            blocked_tries=watch.blocked_tries,
            doors_tried=tuple(sorted(watch.met_closed)),
            doors_wanted=tuple(sorted(doors_wanted)),
            doors_used=tuple(sorted(watch.used)),
            now=now,
            later=later,
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            lost_edges=sum(edge not in graph.edges for edge in self._schedule.edges),
            detour_m=scheduled.detour_m,
            door_tries=watch.door_tries,
            people=count_encounters(people.finish()),
        )

    def _doors_wanted(self, scheduled: ScheduledQuery) -> frozenset[int]:
        """Return the doors on the best path through open edges of the map, from the node nearest to the start."""
        graph = self.runner.map.graph
        truth = self.runner.truth
        system = self.runner.map.system
        nodes = list(graph.nodes)
        gaps = distance(relative(np.array(scheduled.episode.start_pose), truth.poses(nodes)))
        closed = self.closed_edges.among(list(graph.edges), self.world.scene.clearance)
        planner = Planner(graph, system.method.planning, weight=system.edge_weight)
        way = planner.plan(nodes[int(np.argmin(gaps))], scheduled.episode.goal, dict.fromkeys(closed, math.inf))
        return self.closed_edges.doors_on(list(itertools.pairwise(way.nodes)))


def _keep_informed(predictor: Predictor, world: World) -> None:
    """Update an oracle predictor to the current world; a network sees changes in its images."""
    if isinstance(predictor, OraclePredictor):
        predictor.show(world.scene.clearance)
        world.follow(lambda _: predictor.show(world.scene.clearance))


_BINS = 10


def score_presence(
    system: NavigationSystem,
    graph: TopologicalGraph,
    at_s: float,
    edges: Sequence[EdgeKey],
    closed: Collection[EdgeKey],
) -> PresenceScore:
    """Score a system's predictions for `edges` at a time; `closed` are the edges that are truly closed."""
    p = _predicted(system, graph, at_s, edges)
    closed = set(closed)
    is_open = np.array([edge not in closed for edge in edges], bool)
    cells = (
        PresenceBin(cell.pairs, cell.predicted or 0.0, cell.reachable or 0.0)
        for cell in calibration_table(p, is_open, _BINS)
    )
    return PresenceScore(len(edges), float(np.mean((p - is_open) ** 2)) if edges else 0.0, tuple(cells))


def _predicted(system: NavigationSystem, graph: TopologicalGraph, at_s: float, edges: Sequence[EdgeKey]) -> np.ndarray:
    """Return the probabilities (N,) that edges are open; 0 for an edge that was pruned.

    Without a presence filter, the belief p of an edge is used. A map without maintenance predicts that all edges are
    open.
    """
    if system.follows_presence:
        known = system.presence.probabilities(graph, at_s)
        found = [known.get(edge, 1.0) if edge in graph.edges else 0.0 for edge in edges]
    elif isinstance(system.maintenance, NoMaintenance):
        found = [1.0] * len(edges)
    else:
        found = [graph.edges[edge].belief.p if edge in graph.edges else 0.0 for edge in edges]
    return np.array(found, np.float64)
