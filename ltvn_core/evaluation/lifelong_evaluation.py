"""The lifelong evaluation: queries with maintenance, and at intervals the static test with the current map.

A query goes from a random image of the mapping drive to a random node. Edges that a query prunes are driven afterwards
to check whether they were bad; the map does not use the result. The queries of one map run one by one. Queries of
different maps, and static tests of existing maps, run in parallel.
"""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
from joblib import delayed

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.edge_driver import EdgeDriver, EdgeProposal, ImagedScene
from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.ground_truth import calibration_bins
from ltvn_core.evaluation.preparation import prepare
from ltvn_core.evaluation.preparation_progress import EvaluationProgress
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.evaluation.results import LifelongPoint, LifelongResult, is_stored, load_results, save_results
from ltvn_core.evaluation.segments import (
    Episodes,
    Queries,
    ScheduledTest,
    cached_runner,
    load_batches,
    open_runner,
    run_segments,
)
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.evaluation.trials import finish_trial, keep_drawing, prepare_all
from ltvn_core.evaluation.workers import WHOLE, Part, Workers
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import FrameId


class LifelongDrive:
    """A map after some queries, which further queries change."""

    def __init__(self, plan: TrialPlan, files: TrialFiles, first: int) -> None:
        """Load the map after `first` queries, with its scene and network."""
        self._plan = plan
        self._files = files
        self._first = first
        self._runner = open_runner(plan, files, first, maintain=True)
        self._drive_truth = prepare(plan, files)
        self._pruned: dict[int, tuple[Edge, ...]] = {}
        """Edges that each query pruned, in their state before the query."""

    def run(self, query: int) -> QueryResult:
        """Drive a query."""
        runner = self._runner
        rng = np.random.default_rng([self._plan.seed, 5, query])
        known = set(runner.map.graph.nodes)
        before = dict(runner.map.graph.edges)
        episode = self._draw(rng)
        result = runner.run(query, episode, rng, first_frame=self._first_frame(query))
        graph = runner.map.graph
        spurious = runner.truth.spurious(runner.map.graph)
        pruned = before.keys() - graph.edges.keys()
        added = graph.edges.keys() - before.keys()
        self._pruned[query] = tuple(before[edge] for edge in pruned)
        return replace(
            result,
            pruned=len(pruned),
            pruned_spurious=sum(_is_spurious(runner, before[edge]) for edge in pruned),
            added_nodes=len(graph.nodes.keys() - known),
            added_edges=len(added),
            added_spurious=len(added & spurious),
            nodes=len(graph.nodes),
            edges=len(graph.edges),
            spurious_edges=len(spurious),
        )

    def save_map(self, queries: int) -> None:
        """Save the map after a number of queries."""
        plan = self._plan
        settings = {"seed": plan.seed, "queries": queries}
        self._runner.save_map(self._files.map(queries), settings, origin=self._files.map(self._first))

    def check(self, results: Sequence[QueryResult]) -> tuple[QueryResult, ...]:
        """Check the pruned edges by driving them, and count the bad edges for the query that pruned them."""
        pruned = [self._pruned[result.query] for result in results]
        bad = bad_edges(self._runner, [edge for edges in pruned for edge in edges], self._plan.seed)
        counts = (sum((edge.source, edge.target) in bad for edge in edges) for edges in pruned)
        return tuple(replace(result, pruned_bad=count) for result, count in zip(results, counts, strict=True))

    def _draw(self, rng: np.random.Generator) -> EpisodePlan:
        """Draw a start and a goal that is not already reached at the start."""
        drive_truth = self._drive_truth
        nodes = sorted(self._runner.map.graph.nodes)
        while True:
            row = int(rng.integers(len(drive_truth.frames)))
            goal = nodes[int(rng.integers(len(nodes)))]
            start_pose = np.array(drive_truth.poses[row])
            goal_pose = self._runner.truth.pose(goal)
            if not judge_goal_reached(0, start_pose, goal_pose).reached:
                return EpisodePlan(
                    start=drive_truth.frames[row],
                    goal=goal,
                    start_pose=pose_row(start_pose),
                    goal_pose=pose_row(goal_pose),
                )

    def _first_frame(self, query: int) -> FrameId:
        """Return the number of a query's first image; a query takes at most one image per step."""
        steps = self._plan.protocol.steps_in(self._runner.scene)
        return max(self._drive_truth.frames) + 1 + query * (steps + 1)


ATTEMPTS_PER_EDGE = 4
"""Number of attempts at each edge (ours)."""
_MAX_STARTS = 3 * ATTEMPTS_PER_EDGE
"""Maximum number of starts per edge; more than the attempts, because a start without localisation does not count."""


def bad_edges(runner: EpisodeRunner, pruned: Iterable[Edge], seed: int) -> set[EdgeKey]:
    """Return the edges that are spurious, or at which fewer than half of the robot's attempts arrived.

    Attempts start at the exact pose of the source with errors within the controller's tolerance. Each edge has a random
    generator of its own, so that the result does not depend on the other edges.
    """
    bad = set[EdgeKey]()
    for edge in pruned:
        key = edge.source, edge.target
        if key not in bad and (_is_spurious(runner, edge) or _mostly_fails(runner, edge, seed)):
            bad.add(key)
    return bad


def _is_spurious(runner: EpisodeRunner, edge: Edge) -> bool:
    return runner.truth.is_spurious((edge.source, edge.target), by_odometry=edge.by_odometry)


def _mostly_fails(runner: EpisodeRunner, edge: Edge, seed: int) -> bool:
    """Return whether fewer than half of the attempts arrive; False if no attempt could start."""
    rng = np.random.default_rng([seed, 6, edge.source, edge.target])
    proposal = EdgeProposal(
        source=edge.source,
        target=edge.target,
        waypoint=np.array(edge.waypoint),
        reachability=edge.belief.p,
        true=True,
        connected=True,
    )
    driven = 0
    arrived = 0
    with closing(
        EdgeDriver(
            _imaged_scene(runner),
            runner.map.predictor,
            runner.map.system.method,
            np.zeros((1, 3)),
            rng,
            noise=runner.noise,
            body=runner.body,
        )
    ) as attempts:
        for _ in range(_MAX_STARTS):
            attempted = attempts.drive(proposal)
            driven += attempted is not None
            arrived += attempted is not None and attempted.arrived
            if driven == ATTEMPTS_PER_EDGE:
                break
    return 2 * arrived < driven


def _imaged_scene(runner: EpisodeRunner) -> ImagedScene:
    """Return the scene with the images of the map."""
    keyframes = runner.map.keyframes
    poses = {frame: runner.truth.pose(frame) for frame in keyframes.frames}
    return ImagedScene(scene=runner.scene, camera=runner.camera, keyframes=keyframes, poses=poses)


@dataclass(frozen=True, slots=True)
class LifelongSchedule:
    """Number of queries, and interval of the tests."""

    queries: int = 700
    """Number of queries with maintenance (paper)."""
    every: int = 100
    """Number of queries between two static tests (paper)."""
    episodes: int = 500
    """Number of episodes in each static test (paper)."""

    def __post_init__(self) -> None:
        if min(self.queries, self.every, self.episodes) < 1:
            raise OptionError(
                "A lifelong test needs one query, one between two tests and one episode at least, got "
                f"{self.queries} queries, every {self.every}, {self.episodes} episodes."
            )

    @property
    def points(self) -> tuple[int, ...]:
        """Numbers of queries after which the map is tested, from 0 to all."""
        return (*range(0, self.queries, self.every), self.queries)

    @property
    def segments(self) -> tuple[Queries | Episodes, ...]:
        """The segments of the schedule: static tests, and the queries between two tests."""
        tests = (Episodes(at, self.episodes) for at in self.points)
        return (*tests, *(Queries(first, until) for first, until in pairwise(self.points)))

    @property
    def work(self) -> int:
        """Total number of queries and episodes."""
        return self.queries + self.episodes * len(self.points)


def run_lifelong(
    plans: Sequence[TrialPlan],
    folder: Path,
    schedule: LifelongSchedule,
    *,
    command: str,
    parallel: Workers,
    progress: EvaluationProgress,
    part: Part = WHOLE,
) -> list[LifelongResult]:
    """Run the lifelong evaluation of several plans, one scene and seed each; existing results are only read.

    A `part` runs its share of the plans, and returns the results of all finished plans of all parts. Raises OptionError
    if the folder has results with other settings.
    """
    jobs = prepare_all(part.of(plans), folder, parallel, progress)
    run_segments([_scheduled(plan, files, schedule) for plan, files in jobs], parallel, progress)
    list(parallel(delayed(_finish)(plan, files, schedule, command) for plan, files in jobs))
    results = (_result_file(TrialFiles.of(plan, folder), schedule) for plan in plans)
    return [load_results(result, LifelongResult) for result in results if is_stored(result)]


def _scheduled(plan: TrialPlan, files: TrialFiles, schedule: LifelongSchedule) -> ScheduledTest:
    return ScheduledTest(plan, files, schedule.segments, partial(LifelongDrive, plan, files))


def _finish(plan: TrialPlan, files: TrialFiles, schedule: LifelongSchedule, command: str) -> None:
    """Combine the batches and save the result."""
    if is_stored(_result_file(files, schedule)):
        return
    points = tuple(_point(plan, files, at, schedule.episodes, command) for at in schedule.points)
    for at in (schedule.points[0], schedule.points[-1]):  # Figures show the map before and after the queries.
        keep_drawing(plan, files, at)
    result = LifelongResult(
        scene=points[0].trial.scene,
        preset=plan.preset,
        without=plan.parts_off,
        seed=plan.seed,
        points=points,
        queries=tuple(
            query
            for first, until in pairwise(schedule.points)
            for batch in load_batches(files, first, until)
            for query in batch.queries
        ),
        version=version("ltvn"),
        command=command,
        maintenance=plan.maintenance,
    )
    save_results(_result_file(files, schedule), result)


def _point(plan: TrialPlan, files: TrialFiles, at: int, episodes: int, command: str) -> LifelongPoint:
    runner = cached_runner(plan, files, at)
    cells = calibration_bins(runner.map.graph, runner.truth)
    return LifelongPoint(at, finish_trial(plan, files, at, episodes, command), cells)


def _result_file(files: TrialFiles, schedule: LifelongSchedule) -> Path:
    return files.lifelong(schedule.queries, schedule.every, schedule.episodes)
