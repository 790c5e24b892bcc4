"""Drives the queries of a schedule with one map in one changing world, and judges each by the truth of its moment."""

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ltvn_core.evaluation.encounters import EncounterLog, count_encounters
from ltvn_core.evaluation.episode_runner import EpisodeRunner, EventCallback
from ltvn_core.evaluation.open_edges import true_presence
from ltvn_core.evaluation.query_result import PresenceBin, PresenceScore, QueryResult
from ltvn_core.evaluation.results import load_results
from ltvn_core.evaluation.trial_plans import open_planned_system, planned_weights
from ltvn_core.evaluation.true_rooms import true_rooms
from ltvn_core.evaluation.worlds.closed_edges import ClosedEdges, DoorWatch
from ltvn_core.evaluation.worlds.schedule import LATER_S, Schedule, ScheduledQuery
from ltvn_core.evaluation.worlds.world_plans import WorldFiles, WorldPlan
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.navigation_system import NavigationSystem, NoMaintenance
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Event
from ltvn_core.network.metrics.binned_metrics import calibration_table
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.types import FrameId, Pose, Predictor


@dataclass(frozen=True, slots=True)
class _Foretold:
    """What was known before a query began."""

    now: PresenceScore
    later: PresenceScore
    doors_wanted: frozenset[int]


class WorldDrive:
    """A map after some queries, and the world at the next one."""

    def __init__(self, plan: WorldPlan, files: WorldFiles, first: int) -> None:
        """Load the map after `first` queries, with its scene and network."""
        self._plan, self._files = plan, files
        self._first = first
        self._schedule: Schedule = load_results(files.schedule, Schedule)
        self._changing = self._schedule.changing
        scene = load_scene(plan.trial.scene)
        self.world = World(scene, plan.script(scene), start_s=self._schedule.queries[first].at_s)
        predictor = open_predictor(plan.trial.predictor, plan.trial.scene, planned_weights(plan.trial, files.trial))
        _keep_informed(predictor, self.world)
        system = open_planned_system(plan.trial, predictor, scene, maintain=True)
        known = TopologicalMap.load(files.map(first), predictor, system=system)
        truth = true_presence(self.world, known.keyframes.observation)
        room_of = true_rooms(scene, known.keyframes.observation)
        known = replace(known, system=with_maintenance(system, plan.maintenance, truth=truth, room_of=room_of))
        self.runner = EpisodeRunner(scene, known, plan.trial.protocol, world=self.world)
        self.closed_edges = ClosedEdges(scene, self.runner.truth)

    def run(self, query: int, on_event: EventCallback | None = None) -> QueryResult:
        """Let time pass until a query, and drive it."""
        runner, world, scheduled = self.runner, self.world, self._schedule.queries[query]
        if scheduled.at_s > world.time_s:
            world.skip(scheduled.at_s - world.time_s)
        foretold = self._foretell(scheduled)
        watch, people = DoorWatch(world, self.closed_edges), EncounterLog()
        end: Pose = np.array(scheduled.episode.start_pose)

        def consume(event: Event, robot: SimulatedRobot) -> None:
            nonlocal end
            end = robot.exact_pose
            watch.consume(event)
            if on_event is not None:
                on_event(event, robot)

        rng = np.random.default_rng([self._plan.trial.seed, 8, query])
        result = runner.run(
            query,
            scheduled.episode,
            rng,
            on_event=consume,
            first_frame=self._first_frame(query),
            on_step=people.watch,
        )
        goal = np.array([scheduled.episode.goal_pose])
        cut_off = not result.reached and not bool(world.reachable(end, goal)[0])
        met = count_encounters(people.finish())
        return replace(self._result(scheduled, result, foretold, watch, cut_off=cut_off), people=met)

    def save_map(self, queries: int) -> None:
        """Save the map as it is after a number of queries."""
        settings = {
            "seed": self._plan.trial.seed,
            "world": self._plan.world,
            "maintenance": self._plan.maintenance,
            "queries": queries,
        }
        self.runner.save_map(self._files.map(queries), settings, origin=self._files.map(self._first))

    def check(self, results: Sequence[QueryResult]) -> tuple[QueryResult, ...]:
        """Return the results; all is known when a query is over."""
        return tuple(results)

    def _foretell(self, scheduled: ScheduledQuery) -> _Foretold:
        system, graph, at_s = self.runner.map.system, self.runner.map.graph, scheduled.at_s
        score = partial(score_presence, system, graph, edges=self._changing)
        now = score(at_s=at_s, closed=scheduled.closed)
        later = score(at_s=at_s + LATER_S, closed=scheduled.closed_later)
        return _Foretold(now, later, self._doors_wanted(scheduled))

    def _doors_wanted(self, scheduled: ScheduledQuery) -> frozenset[int]:
        """Return the doors on the best way of the map from the node next to the start, given which edges are open."""
        graph, truth, system = self.runner.map.graph, self.runner.truth, self.runner.map.system
        nodes = list(graph.nodes)
        gaps = distance(relative(np.array(scheduled.episode.start_pose), truth.poses(nodes)))
        closed = self.closed_edges.among(list(graph.edges), self.world.scene.clearance)
        planner = Planner(graph, system.method.planning, weight=system.edge_weight)
        way = planner.plan(nodes[int(np.argmin(gaps))], scheduled.episode.goal, dict.fromkeys(closed, math.inf))
        return self.closed_edges.doors_on(list(itertools.pairwise(way.nodes)))

    def _first_frame(self, query: int) -> FrameId:
        """Return the number of a query's first image; changes of the world begin steps of their own."""
        steps = self._plan.trial.protocol.steps_in(self.runner.scene)
        return self._schedule.first_frame + query * 4 * (steps + 1)

    def _result(
        self, scheduled: ScheduledQuery, result: QueryResult, foretold: _Foretold, watch: DoorWatch, *, cut_off: bool
    ) -> QueryResult:
        graph = self.runner.map.graph
        return replace(
            result,
            at_s=scheduled.at_s,
            cut_off=cut_off,
            shortest_m=scheduled.shortest_m,
            blocked_tries=watch.blocked_tries,
            doors_tried=tuple(sorted(watch.met_closed)),
            doors_wanted=tuple(sorted(foretold.doors_wanted)),
            doors_used=tuple(sorted(watch.used)),
            now=foretold.now,
            later=foretold.later,
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            lost_edges=sum(edge not in graph.edges for edge in self._schedule.edges),
            detour_m=scheduled.detour_m,
            door_tries=watch.door_tries,
        )


def _keep_informed(predictor: Predictor, world: World) -> None:
    """Let the oracle know the world as it is; a network sees it."""
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
    """Judge what a system predicts for `edges` at a moment, when `closed` of them are closed."""
    p = _predicted(system, graph, at_s, edges)
    closed = set(closed)
    is_open = np.array([edge not in closed for edge in edges], bool)
    cells = (
        PresenceBin(cell.pairs, cell.predicted or 0.0, cell.reachable or 0.0)
        for cell in calibration_table(p, is_open, _BINS)
    )
    return PresenceScore(len(edges), float(np.mean((p - is_open) ** 2)) if edges else 0.0, tuple(cells))


def _predicted(system: NavigationSystem, graph: TopologicalGraph, at_s: float, edges: Sequence[EdgeKey]) -> np.ndarray:
    """Return (N,) the probabilities; an edge that has left the map is held to be closed.

    Where a system has no notion of presence, what it believes of an edge says both; a static map says yes to all.
    """
    if system.presence is not None:
        known = system.presence.probabilities(graph, at_s)
        found = [known.get(edge, 1.0) if edge in graph.edges else 0.0 for edge in edges]
    elif isinstance(system.maintenance, NoMaintenance):
        found = [1.0] * len(edges)
    else:
        found = [graph.edges[edge].belief.p if edge in graph.edges else 0.0 for edge in edges]
    return np.array(found, np.float64)
