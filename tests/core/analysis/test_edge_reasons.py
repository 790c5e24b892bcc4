"""Why is this edge gone, so weak, chosen, missing; why is this node here: chains of sentences with links."""

from dataclasses import replace

import pytest

from ltvn_core.analysis.edge_explanation import explain_edge, explain_node
from ltvn_core.analysis.plan_explanation import explain_planned_edge
from ltvn_core.analysis.replanning import Rules
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.config import PAPER, PlanningConfig
from ltvn_core.graph import deltas as d
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, Planned, QueryStarted
from tests.core.analysis import example_runs as runs


def test_an_edge_that_was_not_yet_pruned_then_is_not_gone() -> None:
    chain = explain_edge(runs.timeline(), 1, 2, at=Instant(100, 10.0))
    assert "p went from 0.90 to 0.60" in chain[-1].text
    assert "pruned" in explain_edge(runs.timeline(), 1, 2)[-1].text


def test_a_failure_in_the_same_query_makes_an_edge_dearer() -> None:
    rules = Rules(replace(PAPER, planning=PlanningConfig(belief_weight=0.0, failure_penalty=0.4)))
    chain = explain_planned_edge(runs.timeline(), 1, 2, rules, at=Instant(60, 6.0))
    assert [reason.text[:4] for reason in chain if "failed in this" in reason.text] == ["0.40"]
    assert not any("as recorded" in reason.text for reason in chain)


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
        chain = explain_planned_edge(Timeline.of(run), 0, 1, Rules(replace(PAPER, planning=planning)))
        assert not any("as recorded" in reason.text for reason in chain)
        assert any("no image supports" in reason.text for reason in chain) == dearer


def test_an_edge_no_plan_led_through_was_not_chosen() -> None:
    (reason,) = explain_planned_edge(runs.timeline(), 7, 8, Rules(PAPER))
    assert reason.instant is None


def test_a_missing_edge_is_missing_because_of_a_threshold() -> None:
    thresholds = PAPER.building
    texts = [reason.text for reason in explain_edge(runs.timeline(), 0, 2, seen=(0.9, 2.0), thresholds=thresholds)]
    assert texts == [
        "There has never been an edge 0 -> 2.",
        "The network would not join them: d = 2.00 is not below D_c = 1.50.",
    ]
    allowed = explain_edge(runs.timeline(), 0, 2, seen=(0.9, 0.5), thresholds=thresholds)[-1].text
    assert allowed.startswith("The network would join them")


@pytest.mark.parametrize("length", [0, 1, 5, 14, 23, 30])
def test_a_recording_cut_anywhere_still_gives_answers(length: int) -> None:
    timeline = Timeline.of(runs.two_failures()[:length])
    for chain in (
        explain_edge(timeline, 1, 2),
        explain_edge(timeline, 0, 2),
        explain_planned_edge(timeline, 1, 2, Rules(PAPER)),
        explain_node(timeline, 1),
    ):
        assert all(reason.text for reason in chain)
        assert chain
