"""Evaluation in a changing world: drives scheduled queries, and judges each by the state of the world at its time.

All maintenances get the same queries, and each maintenance has its own map.
"""

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from joblib import delayed

from ltvn_core.data.recording.map_file import load_map
from ltvn_core.evaluation.encounters import EncounterLog, count_encounters
from ltvn_core.evaluation.episode_runner import EpisodeRunner, EventCallback
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress
from ltvn_core.evaluation.query_result import PresenceBin, PresenceScore, QueryResult
from ltvn_core.evaluation.results import WorldResult, is_stored, load_results, save_results
from ltvn_core.evaluation.segments import Queries, ScheduledTest, load_batches, run_segments
from ltvn_core.evaluation.trial_plans import (
    TrialFiles,
    claim_settings,
    open_planned_system,
    plan_settings,
    planned_weights,
)
from ltvn_core.evaluation.trials import prepare_all
from ltvn_core.evaluation.workers import WHOLE, Part, Workers
from ltvn_core.evaluation.worlds.world_plans import (
    LATER_S,
    Schedule,
    ScheduledQuery,
    WorldFiles,
    WorldPlan,
    draw_schedule,
)
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
from ltvn_core.types import FrameId, Pose, Predictor


@dataclass(frozen=True, slots=True)
class _Foretold:
    """Predictions before a query, and the doors on its best path."""

    now: PresenceScore
    later: PresenceScore
    doors_wanted: frozenset[int]


class WorldDrive:
    """A map after some queries, in the world at the time of the next query."""

    def __init__(self, plan: WorldPlan, files: WorldFiles, first: int) -> None:
        """Load the map after `first` queries, with its scene and network."""
        self._plan = plan
        self._files = files
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
        """Let time pass until the start of a query, and drive the query."""
        runner = self.runner
        world = self.world
        scheduled = self._schedule.queries[query]
        if scheduled.at_s > world.time_s:
            world.skip(scheduled.at_s - world.time_s)
        foretold = self._foretell(scheduled)
        watch = DoorWatch(world, self.closed_edges)
        people = EncounterLog()
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
        """Save the map after a number of queries."""
        settings = {
            "seed": self._plan.trial.seed,
            "world": self._plan.world,
            "maintenance": self._plan.maintenance,
            "queries": queries,
        }
        self.runner.save_map(self._files.map(queries), settings, origin=self._files.map(self._first))

    def check(self, results: Sequence[QueryResult]) -> tuple[QueryResult, ...]:
        """Return the results unchanged, because they are complete when a query is over."""
        return tuple(results)

    def _foretell(self, scheduled: ScheduledQuery) -> _Foretold:
        system = self.runner.map.system
        graph = self.runner.map.graph
        at_s = scheduled.at_s
        score = partial(score_presence, system, graph, edges=self._changing)
        now = score(at_s=at_s, closed=scheduled.closed)
        later = score(at_s=at_s + LATER_S, closed=scheduled.closed_later)
        return _Foretold(now, later, self._doors_wanted(scheduled))

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

    def _first_frame(self, query: int) -> FrameId:
        """Return the number of a query's first image; changes of the world also begin new steps."""
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


def run_world_evaluation(
    plans: Sequence[WorldPlan],
    folder: Path,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[WorldResult]:
    """Run the evaluation of several plans; existing results are only read.

    A `part` runs its share of the plans, and returns the results of all finished plans of all parts. Raises OptionError
    if the folder has results with other settings, and WorldError if the world is impossible in the scene.
    """
    mine = part.of(plans)
    files_of = dict(prepare_all(list(dict.fromkeys(plan.trial for plan in mine)), folder, parallel, progress))
    jobs = [(plan, WorldFiles.of(plan, files_of[plan.trial])) for plan in mine]
    for plan, files in jobs:
        claim_settings(files.settings, _settings(plan))
    first = {files.schedule: (plan, files) for plan, files in jobs}
    list(parallel(delayed(_schedule)(*job) for job in first.values()))
    run_segments([_scheduled(plan, files) for plan, files in jobs], parallel, progress)
    for plan, files in jobs:
        _finish(plan, files, command)
    results = (WorldFiles.of(plan, TrialFiles.of(plan.trial, folder)).result for plan in plans)
    return [load_results(result, WorldResult) for result in results if is_stored(result)]


def _settings(plan: WorldPlan) -> dict[str, Any]:
    """Return the settings of script and queries, which are the same for all maintenances."""
    file = Path(plan.world)
    script = file.read_text(encoding="utf-8") if file.is_file() else plan.world
    shared = {"trial": plan_settings(plan.trial), "maintenance": "any", "script": script, "version": version("ltvn")}
    return asdict(plan) | shared


def _schedule(plan: WorldPlan, files: WorldFiles) -> None:
    """Draw the queries, unless they exist."""
    if files.schedule.exists():
        return
    scene = load_scene(plan.trial.scene)
    loaded = load_map(files.map(0))
    truth = GroundTruth(scene.clearance, loaded.observations.__getitem__)
    drive_truth = prepare(plan.trial, files.trial)
    save_results(files.schedule, draw_schedule(plan, scene, loaded.graph, truth, drive_truth))


def _scheduled(plan: WorldPlan, files: WorldFiles) -> ScheduledTest:
    """Return the test of a plan, which consists only of queries."""
    return ScheduledTest(
        plan.trial, files.trial, (Queries(0, plan.queries),), partial(WorldDrive, plan, files), query_files=files
    )


def _finish(plan: WorldPlan, files: WorldFiles, command: str) -> None:
    """Combine the batches and save the result."""
    if is_stored(files.result):
        return
    schedule: Schedule = load_results(files.schedule, Schedule)
    batches = load_batches(files, 0, plan.queries)
    result = WorldResult(
        scene=load_scene(plan.trial.scene).name,
        preset=plan.trial.preset,
        without=plan.trial.parts_off,
        seed=plan.trial.seed,
        world=plan.world,
        days=plan.days,
        maintenance=plan.maintenance,
        nodes=schedule.nodes,
        edges=schedule.all_edges,
        true_edges=len(schedule.edges),
        doors=schedule.doors,
        queries=tuple(query for batch in batches for query in batch.queries),
        wall_s=sum(batch.wall_s for batch in batches),
        version=version("ltvn"),
        command=command,
    )
    save_results(files.result, result)
