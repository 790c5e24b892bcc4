"""Metrics of evaluations in a changing world: success of the queries, and changes of the map."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.evaluation.confidence_intervals import SampleGroup, estimates
from ltvn_core.evaluation.query_result import EncounterCounts, PresenceScore, QueryResult
from ltvn_core.evaluation.results import DoorMove, Run
from ltvn_core.network.metrics import SuccessRate

LEAST_DETOUR_M = 0.5


@dataclass(frozen=True, slots=True)
class WorldMetrics:
    """Metrics of one maintenance over one or several maps."""

    queries: int
    success_rate: float
    success_low: float
    """Lower end of the 95 % interval of the success rate."""
    success_high: float
    spl: float
    """Success weighted by path length, relative to the shortest path at that time."""
    spl_low: float
    """Lower end of the 95 % interval of the SPL."""
    spl_high: float
    detours: int
    """Number of queries whose shortest path was longer by at least `LEAST_DETOUR_M` than in the unchanged scene."""
    success_on_detours: float | None
    """Share of the detours whose goals were reached; None if there were none."""
    cut_off: int
    """Number of failures without an open path to the goal at their end."""
    blocked_tries_per_100: float
    """Mean number of attempts along closed edges in 100 queries."""
    door_tries_per_100: float
    """Mean number of attempts along edges through closed doors in 100 queries."""
    reopened_after_queries: float | None
    """Mean number of queries until a reopened door is used again; None without such doors. Counts queries whose best
    path leads through the door, at least 1. Only doors that the robot had met closed are included. A door that closes
    again unused counts one query more."""
    reopened: int
    """Number of reopened doors in this mean."""
    brier: float
    """Mean squared error of p(open) when queries begin, over all edges that the world ever closes."""
    brier_later: float
    """Mean squared error of p(open) one hour after queries begin."""
    calibration: float
    """Mean absolute difference between p(open) and the share of edges that are open, in ten bins."""
    calibration_later: float
    """Calibration error of p(open) one hour after queries begin."""
    lost_edges_share: float
    """Share of the true edges of the first map that are missing after all queries."""
    nodes: float
    """Mean number of nodes of the maps after all queries."""
    edges: float
    nodes_before: float
    """Mean number of nodes of the maps before the queries."""
    edges_before: float
    collisions_per_episode: float
    people: EncounterCounts
    """Encounters with people in all queries."""
    steps_per_episode: float


def world_metrics(results: Sequence[Run]) -> WorldMetrics:
    """Return the metrics of results of one maintenance. Raises ValueError if there are none."""
    queries = [query for result in results for query in result.queries]
    success, spl = (each.within(0, 1) for each in estimates([_sample(result) for result in results]))
    success = success.covering(SuccessRate.of(sum(query.reached for query in queries), len(queries)))
    waits = [wait for result in results for wait in reopening_waits(result.queries, result.maps[0].doors)]
    detours = [query.reached for query in queries if query.detour_m >= LEAST_DETOUR_M]
    now = [query.now for query in queries if query.now is not None]
    later = [query.later for query in queries if query.later is not None]
    return WorldMetrics(
        queries=len(queries),
        success_rate=success.mean,
        success_low=success.low,
        success_high=success.high,
        spl=spl.mean,
        spl_low=spl.low,
        spl_high=spl.high,
        detours=len(detours),
        success_on_detours=_mean(detours) if detours else None,
        cut_off=sum(query.cut_off for query in queries),
        blocked_tries_per_100=100 * _mean(query.blocked_tries for query in queries),
        door_tries_per_100=100 * _mean(_door_tries(query) for query in queries),
        reopened_after_queries=_mean(waits) if waits else None,
        reopened=len(waits),
        brier=_brier(now),
        brier_later=_brier(later),
        calibration=_calibration_error(now),
        calibration_later=_calibration_error(later),
        lost_edges_share=_mean(_lost_share(result) for result in results),
        nodes=_mean(result.queries[-1].nodes for result in results),
        edges=_mean(result.queries[-1].edges for result in results),
        nodes_before=_mean(result.maps[0].map.nodes for result in results),
        edges_before=_mean(result.maps[0].map.edges for result in results),
        collisions_per_episode=_mean(query.collisions for query in queries),
        people=sum((query.people for query in queries), EncounterCounts()),
        steps_per_episode=_mean(query.steps for query in queries),
    )


def reopening_waits(queries: Sequence[QueryResult], doors: Sequence[DoorMove]) -> list[int]:
    """Return the number of queries until the robot used each reopened door that it had met closed.

    Counts the queries whose best path leads through the door, until one drives through it or the door closes again.
    Doors without such queries are left out.
    """
    waits = []
    for opened in (move for move in doors if move.is_open):
        moves = [move for move in doors if move.door == opened.door and not move.is_open]
        closed_s = max((move.at_s for move in moves if move.at_s < opened.at_s), default=opened.at_s)
        until_s = min((move.at_s for move in moves if move.at_s > opened.at_s), default=np.inf)
        met = [query for query in queries if closed_s <= query.at_s < opened.at_s]
        if any(opened.door in query.doors_tried for query in met):
            wait = _wait([query for query in queries if opened.at_s <= query.at_s < until_s], opened.door)
            waits += [wait] if wait else []
    return waits


def _wait(queries: Sequence[QueryResult], door: int) -> int:
    """Count the queries whose best path leads through a door, up to the query that uses the door.

    Returns at least 1 if a query uses the door. Otherwise returns one more than the count, or 0 if the count is 0.
    """
    wanted = 0
    for query in queries:
        wanted += door in query.doors_wanted
        if door in query.doors_used:
            return max(wanted, 1)
    return wanted + 1 if wanted else 0


def _lost_share(result: Run) -> float:
    before = result.maps[0].map
    return result.queries[-1].lost_edges / max(before.edges - before.spurious_edges, 1)


def _door_tries(query: QueryResult) -> int:
    return query.blocked_tries if query.door_tries is None else query.door_tries


def _sample(result: Run) -> SampleGroup:
    rows = [(query.reached, query.spl) for query in result.queries]
    return SampleGroup(result.columns.scene, np.array(rows, np.float64))


def _brier(scores: Sequence[PresenceScore]) -> float:
    weights = [score.predictions for score in scores]
    return float(np.average([score.brier for score in scores], weights=weights)) if sum(weights) else 0.0


def _calibration_error(scores: Sequence[PresenceScore]) -> float:
    """Return the mean gap between prediction and truth over ten bins, weighted by their numbers of predictions."""
    counts = np.array([[cell.predictions for cell in score.bins] for score in scores])
    gaps = np.array([[cell.mean_p - cell.present for cell in score.bins] for score in scores])
    return float(np.abs((counts * gaps).sum(0)).sum() / max(counts.sum(), 1))


def _mean(numbers: Iterable[float]) -> float:
    return float(np.mean(list(numbers)))
