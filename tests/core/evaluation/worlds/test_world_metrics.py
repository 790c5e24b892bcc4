"""The metrics of made-up results in a changing world."""

from dataclasses import replace

import pytest

from ltvn_core.evaluation.query_result import PresenceBin, PresenceScore, QueryResult
from ltvn_core.evaluation.results import DoorMove, MapTruthMetrics, Run
from ltvn_core.evaluation.worlds.world_metrics import reopening_waits, world_metrics
from tests.core.evaluation.reports.fake_results import make_world_result

EMPTY = PresenceBin(0, 0.0, 0.0)


def score(p: float, present: float, predictions: int = 10) -> PresenceScore:
    """Predictions that all lie in the last bin."""
    brier = present * (1 - p) ** 2 + (1 - present) * p**2
    return PresenceScore(predictions, brier, (*[EMPTY] * 9, PresenceBin(predictions, p, present)))


def query(
    number: int,
    *,
    tried: tuple[int, ...] = (),
    wanted: tuple[int, ...] = (),
    used: tuple[int, ...] = (),
    reached: bool = True,
    present: float = 1.0,
    detour_m: float = 0.0,
) -> QueryResult:
    return QueryResult(
        query=number,
        at_s=100.0 * number,
        start=0,
        goal=1,
        reached=reached,
        outcome="arrived" if reached else "step limit",
        failure=None,
        cut_off=False,
        steps=100,
        collisions=number % 2,
        path_m=8.0,
        shortest_m=4.0,
        blocked_tries=2 * len(tried),
        doors_tried=tried,
        doors_wanted=wanted,
        doors_used=used,
        now=score(1.0, present),
        later=score(1.0, present),
        nodes=50,
        edges=95,
        lost_edges=number,
        detour_m=detour_m,
    )


def result(queries: list[QueryResult], seed: int = 0) -> Run:
    made = make_world_result()
    columns = replace(made.columns, seed=seed)
    counts = MapTruthMetrics(nodes=40, edges=100, spurious_edges=10, pieces=1, goals_connected=3)
    return Run(columns, (replace(made.maps[0], columns=columns, map=counts),), tuple(queries))


def moves(*times: float, door: int = 3) -> list[DoorMove]:
    """Closed and opened in turn."""
    return [DoorMove(at_s, door, is_open=bool(k % 2)) for k, at_s in enumerate(times)]


def test_a_reopened_door_waits_for_the_first_query_that_wants_it_and_uses_it() -> None:
    asked = [query(0), query(1, tried=(3,)), query(2), query(3, wanted=(3,)), query(4, wanted=(3,), used=(3,))]
    assert reopening_waits(asked, moves(50, 150)) == [2]
    assert reopening_waits([*asked[:3], query(3, wanted=(3,), used=(3,))], moves(50, 150)) == [1]


def test_a_door_that_nobody_met_closed_or_nobody_wanted_waits_for_nothing() -> None:
    assert reopening_waits([query(1), query(2, wanted=(3,), used=(3,))], moves(50, 150)) == []
    assert reopening_waits([query(1, tried=(3,)), query(2)], moves(50, 150)) == []


def test_a_door_that_closes_again_unused_counts_one_more_query_than_wanted_it() -> None:
    asked = [query(1, tried=(3,)), query(2, wanted=(3,)), query(3, wanted=(3,)), query(9, wanted=(3,), used=(3,))]
    assert reopening_waits(asked, moves(50, 150, 350)) == [3]


def test_means_are_taken_over_all_queries_and_ends_over_all_maps() -> None:
    found = world_metrics([result([query(0), query(1, reached=False)]), result([query(0), query(1, tried=(0,))], 1)])
    assert (found.queries, found.success_rate, found.spl) == (4, 0.75, 0.375)
    assert found.success_low < 0.5
    assert found.success_high == 1.0
    assert (found.blocked_tries_per_100, found.door_tries_per_100, found.collisions_per_episode) == (50.0, 50.0, 0.5)
    assert found.lost_edges_share == pytest.approx(1 / 90)
    assert (found.nodes, found.nodes_before, found.edges, found.edges_before) == (50, 40, 95, 100)
    assert found.reopened_after_queries is None


def test_calibration_is_judged_over_all_moments_and_not_at_each() -> None:
    # Half of the edges are open at one moment and all at another, so three quarters in all.
    found = world_metrics([result([query(0, present=0.5), query(1, present=1.0)])])
    assert found.brier == pytest.approx(0.25)
    assert found.calibration == pytest.approx(0.25)


def test_queries_whose_usual_way_is_closed_are_counted_by_themselves() -> None:
    found = world_metrics([result([query(0, detour_m=2.0), query(1, detour_m=2.0, reached=False), query(2)])])
    assert (found.detours, found.success_on_detours) == (2, 0.5)
    assert world_metrics([result([query(0)])]).success_on_detours is None
