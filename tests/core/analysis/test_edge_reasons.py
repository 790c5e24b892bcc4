"""Why is this edge gone, so weak, chosen, missing; why is this node here: chains of sentences with links."""

import pytest

from ltvn_core.analysis import edge_explanation as why
from ltvn_core.analysis.plan_alternative import ExplanationKind, plan_alternative
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.config import PAPER, ROBUST, BeliefConfig, PlanningConfig
from ltvn_core.graph import deltas as d
from ltvn_core.graph.operators import OperatorThresholds
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, Planned, QueryStarted
from tests.core.analysis import example_runs as runs


def test_a_pruned_edge_is_gone_because_of_its_failures() -> None:
    chain = why.explain_pruned_edge(runs.timeline(), 1, 2, believing=BeliefConfig())
    assert [(reason.kind, reason.instant and reason.instant.step) for reason in chain] == [
        (ExplanationKind.BORN, 10),
        (ExplanationKind.ATTEMPT, 60),
        (ExplanationKind.ATTEMPT, 60),
        (ExplanationKind.ATTEMPT, 140),
        (ExplanationKind.GONE, 140),
    ]
    assert "p from 0.90 to 0.60" in chain[1].text
    assert "did not change its belief" in chain[2].text
    assert chain[-1].text == "It was pruned after attempt 4: p = 0.20, below R_p = 0.50, with 2 failures."
    assert all(reason.ids == (1, 2) for reason in chain)


def test_an_edge_that_was_not_yet_pruned_then_is_not_gone() -> None:
    chain = why.explain_pruned_edge(runs.timeline(), 1, 2, at=Instant(100, 10.0))
    assert chain[-1].text == "Edge 1 -> 2 is not gone: p = 0.60, length (mu) = 1.00."


def test_an_edge_goes_with_its_node_or_with_its_map() -> None:
    dropped = [*runs.two_failures(), *runs.at(190, GraphChanged(d.NodeDropped(1, d.Cause.HAND)))]
    assert (
        why.explain_pruned_edge(Timeline.of(dropped), 0, 1)[-1].text == "It was removed together with node 1, by hand."
    )
    replaced = [*runs.two_failures(), *runs.at(190, runs.node(0, cause=d.Cause.LOAD))]
    assert (
        "another map replaced this one, with a map from a file"
        in why.explain_pruned_edge(Timeline.of(replaced), 0, 1)[-1].text
    )


def test_a_weak_edge_is_weak_because_of_what_driving_taught() -> None:
    chain = why.explain_edge_belief(runs.timeline(), 1, 2, at=Instant(100, 10.0))
    assert (
        chain[-1].text == "1 attempt counted, 0 with success: p went from 0.90 to 0.60, length (mu) from 1.00 to 1.00."
    )


def test_an_edge_is_chosen_because_the_detour_costs_more() -> None:
    chain = why.explain_planned_edge(runs.timeline(), 0, 1, PAPER.planning)
    assert [reason.kind for reason in chain] == [
        ExplanationKind.PLAN,
        ExplanationKind.BELIEF,
        ExplanationKind.ALTERNATIVE,
    ]
    assert "cost 2.00" in chain[0].text
    assert "costs 3.00, 1.00 more" in chain[-1].text
    assert chain[-1].ids == (0, 3, 2)


def test_an_edge_without_an_alternative_is_chosen_because_there_is_none() -> None:
    chain = why.explain_planned_edge(runs.timeline(), 1, 2, PAPER.planning, at=Instant(40, 4.0))
    assert chain[-1].text == "Without it there is no path at all."


def test_a_failure_in_the_same_query_makes_an_edge_dearer() -> None:
    made = plan_alternative(
        runs.timeline(), 1, 2, PlanningConfig(belief_weight=0.0, failure_penalty=0.4), at=Instant(60, 6.0)
    )
    assert made is not None
    assert (made.penalty, made.matches_recording) == (0.4, True)


def test_an_edge_that_no_image_supports_is_dearer_for_a_robot_that_is_unsure_of_its_place() -> None:
    blind = GraphChanged(
        d.EdgeAdded(d.Edge(0, 1, d.PoseRow(1.0, 0.0, 0.0), d.Belief(0.9, 1.0, 0.02), by_odometry=True), d.Cause.BUILD)
    )
    planning = PlanningConfig(belief_weight=0.0)
    planner = Planner(TopologicalGraph([each.delta for each in (runs.node(0), runs.node(1), blind)]), planning)
    sure = planner.plan(0, 1)
    for place_p, dearer in ((0.9, False), (0.3, True), (None, False)):
        planned_cost = sure.cost + 3.0 * dearer
        run = [
            *runs.at(10, runs.node(0), runs.node(1), blind),
            *runs.at(20, QueryStarted(0, 1), Planned(0, (0, 1), planned_cost, place_p)),
        ]
        made = plan_alternative(Timeline.of(run), 0, 1, planning)
        assert made is not None
        assert made.matches_recording
        assert bool(made.blind_cost) == dearer
        chain = why.explain_planned_edge(Timeline.of(run), 0, 1, planning)
        assert any("no image supports" in reason.text for reason in chain) == dearer


def test_other_thresholds_than_the_runs_are_said() -> None:
    made = plan_alternative(runs.timeline(), 0, 1, ROBUST.planning)
    assert made is not None
    assert not made.matches_recording
    assert any(
        "Planning again" in reason.text for reason in why.explain_planned_edge(runs.timeline(), 0, 1, ROBUST.planning)
    )


def test_an_edge_no_plan_led_through_was_not_chosen() -> None:
    (reason,) = why.explain_planned_edge(runs.timeline(), 7, 8, PAPER.planning)
    assert reason.kind is ExplanationKind.NEVER


def test_a_missing_edge_is_missing_because_of_a_threshold() -> None:
    thresholds = OperatorThresholds.building(PAPER.building)
    texts = [
        reason.text
        for reason in why.explain_missing_edge(runs.timeline(), 0, 2, seen=(0.9, 2.0), thresholds=thresholds)
    ]
    assert texts == [
        "There has never been an edge 0 -> 2.",
        "The network would not join them: d = 2.00 is not below D_c = 1.50.",
    ]
    allowed = why.explain_missing_edge(runs.timeline(), 0, 2, seen=(0.9, 0.5), thresholds=thresholds)[-1].text
    assert allowed.startswith("The network would join them")


def test_a_missing_edge_is_missing_because_a_node_is_only_in_the_reserve() -> None:
    run = [*runs.square(), *runs.at(10, GraphChanged(d.FramesReserved((8,), d.Cause.BUILD)))]
    assert [reason.text for reason in why.explain_missing_edge(Timeline.of(run), 1, 8)] == [
        "There has never been an edge 1 -> 8.",
        "Node 8 is not in the map, only in the reserve.",
    ]


def test_the_way_back_is_named_and_a_pruned_edge_is_gone_rather_than_missing() -> None:
    assert why.explain_missing_edge(runs.timeline(), 1, 0)[-1].text == "The reverse edge 0 -> 1 exists."
    assert why.explain_missing_edge(runs.timeline(), 1, 2)[-1].kind is ExplanationKind.GONE


def test_a_node_is_here_because_there_was_no_path_or_nobody_recognised_the_place() -> None:
    expanded = [
        *runs.square(),
        *runs.at(20, QueryStarted(3, 0), runs.localised(3, 20, 2)),
        *runs.at(20, runs.node(8, cause=d.Cause.EXPAND), runs.edge(8, 2, cause=d.Cause.EXPAND)),
        *runs.at(20, runs.edge(2, 8, cause=d.Cause.EXPAND), Planned(3, (2, 8, 0), 2.0)),
        *runs.at(30, runs.localised(3, 30, None), runs.localised(3, 32, None)),
        *runs.at(32, runs.node(32, cause=d.Cause.NOVEL), runs.edge(32, 1, cause=d.Cause.NOVEL)),
    ]
    timeline = Timeline.of(expanded)
    assert [reason.text for reason in why.explain_node(timeline, 8)] == [
        "Node 8 was added because there was no path without it.",
        "In query 3 no path led from node 2 to 0; a path through image 8 did.",
        "It was joined with 1 node: 2.",
        "1 plan led through it, the last one in query 3.",
    ]
    assert why.explain_node(timeline, 32)[1].text == "In query 3 the robot had not recognised anything in 2 looks."


def test_an_image_that_never_was_a_node_says_so() -> None:
    assert [reason.kind for reason in why.explain_node(runs.timeline(), 77)] == [ExplanationKind.NEVER]


@pytest.mark.parametrize("length", [0, 1, 5, 14, 23, 30])
def test_a_recording_cut_anywhere_still_gives_answers(length: int) -> None:
    timeline = Timeline.of(runs.two_failures()[:length])
    for chain in (
        why.explain_pruned_edge(timeline, 1, 2),
        why.explain_edge_belief(timeline, 1, 2),
        why.explain_missing_edge(timeline, 1, 2),
        why.explain_planned_edge(timeline, 1, 2, PAPER.planning),
        why.explain_node(timeline, 1),
    ):
        assert all(reason.text for reason in chain)
        assert chain
