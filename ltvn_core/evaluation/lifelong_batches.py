"""Runs queries with maintenance in batches; each batch starts with the map that the one before it saved.

A finished batch is two files, the map and the changes by its queries, so an interrupted test continues at the last map.
Frame numbers and random generators depend on the number of the query only, so interruptions do not change results.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ltvn_core.evaluation.episode_runner import EpisodeRunner
from ltvn_core.evaluation.preparation import DriveGroundTruth, prepare
from ltvn_core.evaluation.protocol import EpisodePlan
from ltvn_core.evaluation.pruned_edges import bad_edges
from ltvn_core.evaluation.results import LifelongQuery, load_results, save_results
from ltvn_core.evaluation.trial_plans import TrialFiles, TrialPlan
from ltvn_core.evaluation.trials import open_runner
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.operators import pose_row
from ltvn_core.navigation.episode import judge_goal_reached
from ltvn_core.types import FrameId

QUERIES_PER_BATCH = 25
"""Queries in a batch: few are lost by an interruption, and the map is not loaded too often."""


@dataclass(frozen=True, slots=True)
class QueryBatch:
    """The results of a batch of queries."""

    queries: tuple[LifelongQuery, ...]
    wall_s: float


class _DrivenQuery(NamedTuple):
    """One query before its pruned edges are checked."""

    query: LifelongQuery
    pruned: tuple[Edge, ...]
    """The pruned edges as they were before the query."""


def run_queries(plan: TrialPlan, files: TrialFiles, first: int, until: int) -> int:
    """Drive the queries from `first` up to `until` in batches; return their number."""
    for begin, end in query_batches(first, until):
        run_query_batch(plan, files, begin, end - begin)
    return until - first


def query_batches(first: int, until: int) -> list[tuple[int, int]]:
    """Return the first query of each batch, and the one after its last."""
    return [(begin, min(begin + QUERIES_PER_BATCH, until)) for begin in range(first, until, QUERIES_PER_BATCH)]


def load_queries(files: TrialFiles, first: int, until: int) -> tuple[LifelongQuery, ...]:
    """Read the results of the queries from `first` up to `until`. Raises OptionError if some are missing."""
    found: list[QueryBatch] = [
        load_results(files.query_batch(*each), QueryBatch) for each in query_batches(first, until)
    ]
    return tuple(query for query_batch in found for query in query_batch.queries)


def run_query_batch(plan: TrialPlan, files: TrialFiles, first: int, count: int) -> int:
    """Drive a batch of queries with maintenance, starting with the map after `first` queries; return their number.

    Writes the map and the changes by the queries; does nothing if both files exist.
    """
    until = first + count
    if files.query_batch(first, until).exists() and files.map(until).exists():
        return count
    started = time.monotonic()
    runner = open_runner(plan, files, first, maintain=True)
    drive_truth = prepare(plan, files)
    driven = [_drive(plan, runner, drive_truth, query) for query in range(first, until)]
    if not files.map(until).exists():
        _save(plan, files, runner, first, until)
    if not files.query_batch(first, until).exists():
        results = _with_bad_edges(runner, driven, plan.seed)
        save_results(files.query_batch(first, until), QueryBatch(results, time.monotonic() - started))
    return count


def _drive(plan: TrialPlan, runner: EpisodeRunner, drive_truth: DriveGroundTruth, query: int) -> _DrivenQuery:
    """Drive one query from a random image of the mapping drive to a random node."""
    rng = np.random.default_rng([plan.seed, 5, query])
    known = set(runner.map.graph.nodes)
    before = dict(runner.map.graph.edges)
    episode = _draw(runner, drive_truth, rng)
    frame = _first_frame(plan, runner, drive_truth, query)
    result = runner.run(query, episode, rng, first_frame=frame)
    graph = runner.map.graph
    spurious = runner.truth.spurious(runner.map.graph)
    pruned = before.keys() - graph.edges.keys()
    added = graph.edges.keys() - before.keys()
    result = LifelongQuery(
        query=query,
        reached=result.reached,
        outcome=result.outcome,
        steps=result.steps,
        collisions=result.collisions,
        pruned=len(pruned),
        pruned_bad=0,
        pruned_spurious=sum(runner.truth.is_spurious(edge) for edge in pruned),
        added_nodes=len(graph.nodes.keys() - known),
        added_edges=len(added),
        added_spurious=len(added & spurious),
        nodes=len(graph.nodes),
        edges=len(graph.edges),
        spurious_edges=len(spurious),
    )
    return _DrivenQuery(result, tuple(before[edge] for edge in pruned))


def _draw(runner: EpisodeRunner, drive_truth: DriveGroundTruth, rng: np.random.Generator) -> EpisodePlan:
    """Draw a start and a goal that is not already reached at the start."""
    nodes = sorted(runner.map.graph.nodes)
    while True:
        start = int(rng.integers(len(drive_truth.frames)))
        goal = nodes[int(rng.integers(len(nodes)))]
        ends = np.array(drive_truth.poses[start]), runner.truth.pose(goal)
        if not judge_goal_reached(0, *ends).reached:
            return EpisodePlan(
                start=drive_truth.frames[start], goal=goal, start_pose=pose_row(ends[0]), goal_pose=pose_row(ends[1])
            )


def _first_frame(plan: TrialPlan, runner: EpisodeRunner, drive_truth: DriveGroundTruth, query: int) -> FrameId:
    """Return the number of a query's first image: no query takes more images than it has steps."""
    return max(drive_truth.frames) + 1 + query * (plan.protocol.steps_in(runner.scene) + 1)


def _save(plan: TrialPlan, files: TrialFiles, runner: EpisodeRunner, first: int, until: int) -> None:
    config = {"verb": "lifelong", "seed": plan.seed, "queries": until}
    runner.map.save(files.map(until), config=config, origin=files.map(first))


def _with_bad_edges(runner: EpisodeRunner, driven: Sequence[_DrivenQuery], seed: int) -> tuple[LifelongQuery, ...]:
    """Check the pruned edges, and count the bad ones for the query that pruned them."""
    bad = bad_edges(runner, [edge for each in driven for edge in each.pruned], seed)
    counts = (sum((edge.source, edge.target) in bad for edge in each.pruned) for each in driven)
    return tuple(replace(each.query, pruned_bad=count) for each, count in zip(driven, counts, strict=True))
