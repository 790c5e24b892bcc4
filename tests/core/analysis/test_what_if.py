"""Other plans and other maps are seen without touching what was recorded."""

import itertools
import math
from dataclasses import replace
from functools import cache

import pytest

from ltvn_core.analysis import what_if_changes as w
from ltvn_core.analysis.replanning import (
    EdgeWeightFactory,
    Moment,
    PlanDifference,
    Rules,
    imagine,
    ltvn_edge_weight,
    moment_at,
    replan,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.config import ROBUST
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, MapError, OptionError
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation import events as e
from ltvn_core.systems.registry import open_system
from tests.core.graph.small_maps import edge_added, node_added
from tests.repository import DEMO_DRIVE


def diamond() -> TopologicalGraph:
    """Two ways from 0 to 3: by 1, which is short, and by 2; node 4 is on its own."""
    ways = ((0, 1, 0.5), (1, 3, 0.5), (0, 2, 0.8), (2, 3, 0.8))
    return TopologicalGraph([*map(node_added, range(5)), *(edge_added(*way, attempts=6, successes=1) for way in ways)])


ASKED = Moment(diamond(), 0, 3)
PLAIN = Rules(ROBUST)


def both(
    moment: Moment, *changes: w.WhatIfChange, edge_weight_of: EdgeWeightFactory = ltvn_edge_weight
) -> PlanDifference:
    """Return the plans without and with the changes."""
    rules = PLAIN._replace(edge_weight_of=edge_weight_of)
    return PlanDifference(replan(moment, (), rules), replan(moment, changes, rules))


SURE = Belief(0.9, 0.1, 0.02)


@pytest.mark.parametrize(
    ("change", "nodes"),
    [
        (w.WithoutEdge(0, 1), (0, 2, 3)),
        (w.WithEdge(0, 3, SURE), (0, 3)),
        (w.WithEdge(0, 1, Belief(0.9, 9.0, 0.02)), (0, 2, 3)),
        (w.WithBelief(1, 3, p=0.1), (0, 2, 3)),
        (w.WithBelief(1, 3, mu=4.0), (0, 2, 3)),
        (w.WithGoal(1), (0, 1)),
        (w.WithGoal(4), ()),
        (w.WithStart(2), (2, 3)),
        (w.WithThreshold(w.WhatIfThreshold.D_C, 0.7), (0, 1, 3)),
        (w.WithThreshold(w.WhatIfThreshold.D_C, 0.4), ()),
        (w.WithThreshold(w.WhatIfThreshold.R_P, 0.95), ()),
        (w.WithThreshold(w.WhatIfThreshold.BELIEF_WEIGHT, 0.0), (0, 1, 3)),
    ],
)
def test_a_change_leads_to_the_plan_one_expects(change: w.WhatIfChange, nodes: tuple[int, ...]) -> None:
    found = both(ASKED, change)
    assert found.old.path.nodes == (0, 1, 3)
    assert found.new.path.nodes == nodes
    assert {*found.removed_edges, *found.added_edges} == {(0, 1), (1, 3)} ^ set(itertools.pairwise(nodes))
    assert found.sentence.endswith(".")
    assert ASKED.graph == diamond()


def test_a_baseline_plans_with_its_own_weights() -> None:
    assert both(ASKED, w.WithBelief(0, 1, mu=9.0)).new.path.nodes == (0, 2, 3)
    found = both(
        ASKED,
        w.WithBelief(0, 1, mu=9.0),
        w.WithThreshold(w.WhatIfThreshold.BELIEF_WEIGHT, 2.0),
        edge_weight_of=lambda method: open_system("sptm", method).edge_weight,
    )
    assert found.new.path.cost == 2.0
    assert found.sentence.startswith("The same path")
    assert "nothing changes" in found.new.notes[0]


def test_a_path_costs_what_its_edges_cost() -> None:
    failed = Moment(diamond(), 0, 3, {(0, 1): 2})
    found = both(failed, w.WithThreshold(w.WhatIfThreshold.FAILURE_PENALTY, 0.0))
    assert found.old.path.nodes == (0, 2, 3)
    assert found.new.path.nodes == (0, 1, 3)
    for plan in (found.old, found.new):
        assert sum(edge.mu + edge.doubt + edge.penalty for edge in plan.edges) == pytest.approx(plan.path.cost)
    assert replan(failed, [w.WithoutEdge(0, 2)], PLAIN).edges[0].penalty == 4.0


def test_a_robot_that_is_unsure_of_its_place_pays_for_edges_that_no_image_supports() -> None:
    graph = diamond()
    supported = graph.edges[0, 1]
    graph.apply(EdgePruned(0, 1, Cause.HAND))
    graph.apply(EdgeAdded(replace(supported, by_odometry=True), Cause.BUILD))
    for place_p, penalty in ((0.9, 0.0), (0.3, 3.0)):
        found = replan(Moment(graph, 0, 1, place_p=place_p), (), PLAIN)
        assert sum(part.penalty for part in found.edges) == penalty


@cache
def demo() -> tuple[Recording, list[e.StampedEvent]]:
    recording = Recording.open(DEMO_DRIVE)
    return recording, recording.events


def test_without_a_change_the_plan_is_the_recorded_one() -> None:
    recording, events = demo()
    method = replace(ROBUST, planning=replace(ROBUST.planning, **recording.meta.config["method"]["planning"]))
    for k in [k for k, stamped in enumerate(events) if isinstance(stamped.event, e.Planned)][::5]:
        planned, past = events[k].event, events[:k]
        assert isinstance(planned, e.Planned)
        found = replan(moment_at(Timeline.of(past)), (), Rules(method))
        assert found.path.nodes == planned.nodes
        assert found.path.cost == pytest.approx(planned.cost)


def test_failures_of_a_query_are_forgotten_in_the_next() -> None:
    ended = e.AttemptEnded(0, 1, 0, 2, 5, e.AttemptEnd.TIMEOUT, 1.0, 0.1, succeeded=False, reason="")
    events = [e.StampedEvent(1, 0.1, e.QueryStarted(0, 3)), e.StampedEvent(1, 0.1, e.Planned(0, (0, 1, 2, 3), 1.0))]
    events += [e.StampedEvent(2, 0.2, ended), e.StampedEvent(3, 0.3, e.QueryStarted(1, 4))]
    assert moment_at(Timeline.of(events), Instant(2, 0.2)).failures == {(0, 1): 1, (1, 2): 1}
    after = moment_at(Timeline.of(events))
    assert (after.source, after.goal, after.failures) == (None, 4, {})
    assert moment_at(Timeline.of(events[2:3])).failures == {(0, 2): 1}


def test_a_moment_without_a_question_has_no_plan_but_says_why() -> None:
    found = replan(moment_at(Timeline()), (), PLAIN)
    assert found.path.nodes == ()
    assert math.isinf(found.path.cost)
    assert "where the robot is" in found.notes[0]


def test_a_smaller_distance_of_localisation_may_lose_the_robot() -> None:
    look = e.Localised(0, 5, 0, 0.8, 0.9, None, math.inf, "global")
    asked = Moment(diamond(), 0, 3, localised=look)
    found = replan(asked, [w.WithThreshold(w.WhatIfThreshold.D_L, 0.5)], PLAIN)
    assert found.path.nodes == ()
    assert "lost" in found.notes[0]
    assert replan(asked, [w.WithThreshold(w.WhatIfThreshold.D_L, 0.9)], PLAIN).path.nodes == (0, 1, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (w.WithoutEdge(3, 0), "Edge 3 -> 0 is not in the map"),
        (w.WithBelief(0, 3, p=0.5), "force it in"),
        (w.WithBelief(0, 1, p=1.5), r"must lie in \[0, 1\]"),
        (w.WithEdge(0, 9, SURE), "Node 9 is not in the map"),
        (w.WithGoal(9), "Node 9 is not in the map"),
        (w.WithThreshold(w.WhatIfThreshold.D_L, -1.0), "D_l cannot be -1"),
        (w.WithThreshold(w.WhatIfThreshold.R_P, math.nan), "R_p cannot be nan"),
    ],
)
def test_what_cannot_be_imagined_is_said(change: w.WhatIfChange, message: str) -> None:
    with pytest.raises(LtvnError, match=message):
        replan(ASKED, [change], PLAIN)


@pytest.fixture
def graph() -> TopologicalGraph:
    """Two places a metre apart, joined one way."""
    between = Edge(12, 40, PoseRow(1, 0, 0), Belief(0.6, 1.1, 0.02))
    return TopologicalGraph([node_added(12), node_added(40, 1.0), EdgeAdded(between, Cause.BUILD)])


@pytest.mark.parametrize("text", w.WHAT_IF_EXAMPLES)
def test_each_example_is_read_and_written_back(text: str) -> None:
    change = w.parse_what_if_change(text)
    assert w.parse_what_if_change(w.format_what_if_change(change)) == change


def test_what_is_typed_means_what_it_says() -> None:
    assert w.parse_what_if_change("without 12 → 40") == w.WithoutEdge(12, 40)
    assert w.parse_what_if_change(" P( 12->40 )=.1") == w.WithBelief(12, 40, p=0.1)
    assert w.parse_what_if_change("mu(12->40) = 2") == w.WithBelief(12, 40, mu=2.0)
    assert w.parse_what_if_change("GOAL 40") == w.WithGoal(40)
    assert w.parse_what_if_change("d_c=1.3") == w.WithThreshold(w.WhatIfThreshold.D_C, 1.3)


def imagined(graph: TopologicalGraph, text: str) -> TopologicalGraph:
    return imagine(Moment(graph), [w.parse_what_if_change(text)], PLAIN)[0].graph


def test_an_edge_that_is_there_keeps_its_belief_and_a_new_one_is_believed_in(graph: TopologicalGraph) -> None:
    known, fresh = imagined(graph, "with 12->40"), imagined(graph, "with 40->12")
    assert known.edges[12, 40].belief == Belief(0.6, 1.1, 0.02)
    assert fresh.edges[40, 12].belief.p == ROBUST.believing.p_cap


def test_a_new_edge_needs_both_of_its_nodes(graph: TopologicalGraph) -> None:
    with pytest.raises(MapError, match="99"):
        imagined(graph, "with 12->99")


@pytest.mark.parametrize(
    "text", ["", "goal", "goal kitchen", "R_q = 1", "R_p = high", "R_p = nan", "p(1) = 2", "12->40"]
)
def test_anything_else_is_answered_with_what_can_be_typed(text: str) -> None:
    with pytest.raises(OptionError) as told:
        w.parse_what_if_change(text)
    assert "write" in str(told.value)
    assert isinstance(told.value, LtvnError)
