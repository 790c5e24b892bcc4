"""Why is this edge gone, so weak, chosen, missing; why is this node here: chains of sentences with links."""

from pathlib import Path

import pytest

from ltvn_core.analysis import blame
from ltvn_core.analysis.choice import choice
from ltvn_core.analysis.reasons import ReasonKind
from ltvn_core.analysis.timeline import Instant, Timeline
from ltvn_core.config import PAPER, ROBUST, Believing, Planning
from ltvn_core.graph.deltas import Cause, FramesReserved, NodeDropped
from ltvn_core.graph.operators import Gates
from ltvn_core.nav.events import GraphChanged, Planned, QueryStarted
from ltvn_core.recording.reader import Recording
from tests.core.analysis import runs

DRIVE = Path(__file__).parents[3] / "recordings" / "demo-drive.rrd"


def test_a_pruned_edge_is_gone_because_of_its_failures() -> None:
    chain = blame.gone(runs.timeline(), 1, 2, believing=Believing())
    assert [(reason.kind, reason.instant and reason.instant.step) for reason in chain] == [
        (ReasonKind.BORN, 10),
        (ReasonKind.ATTEMPT, 60),
        (ReasonKind.ATTEMPT, 60),
        (ReasonKind.ATTEMPT, 140),
        (ReasonKind.GONE, 140),
    ]
    assert "p from 0.90 to 0.60" in chain[1].text
    assert "taught nothing" in chain[2].text
    assert chain[-1].text == "It was pruned after attempt 4: p = 0.20, below R_p = 0.50, with 2 failures."
    assert all(reason.ids == (1, 2) for reason in chain)


def test_an_edge_that_was_not_yet_pruned_then_is_not_gone() -> None:
    chain = blame.gone(runs.timeline(), 1, 2, at=Instant(100, 10.0))
    assert chain[-1].text == "Edge 1 -> 2 is not gone: p = 0.60, mu = 1.00."


def test_an_edge_goes_with_its_node_or_with_its_map() -> None:
    dropped = [*runs.two_failures(), *runs.at(190, GraphChanged(NodeDropped(1, Cause.HAND)))]
    assert blame.gone(Timeline.of(dropped), 0, 1)[-1].text == "It went with node 1, which left by hand."
    replaced = [*runs.two_failures(), *runs.at(190, runs.node(0, cause=Cause.LOAD))]
    assert "another one came in with a map out of a file" in blame.gone(Timeline.of(replaced), 0, 1)[-1].text


def test_a_weak_edge_is_weak_because_of_what_driving_taught() -> None:
    chain = blame.weak(runs.timeline(), 1, 2, at=Instant(100, 10.0))
    assert chain[-1].text == "1 attempt counted, 0 with success: p went from 0.90 to 0.60, mu from 1.00 to 1.00."


def test_an_edge_nobody_drove_is_as_weak_as_the_network_made_it() -> None:
    assert "as it came in: p = 0.90, mu = 1.50" in blame.weak(runs.timeline(), 0, 3)[-1].text


def test_an_edge_is_chosen_because_the_detour_costs_more() -> None:
    chain = blame.chosen(runs.timeline(), 0, 1, PAPER.planning)
    assert [reason.kind for reason in chain] == [ReasonKind.PLAN, ReasonKind.BELIEF, ReasonKind.ALTERNATIVE]
    assert "cost 2.00" in chain[0].text
    assert "costs 3.00, 1.00 more" in chain[-1].text
    assert chain[-1].ids == (0, 3, 2)


def test_an_edge_without_an_alternative_is_chosen_because_there_is_none() -> None:
    chain = blame.chosen(runs.timeline(), 1, 2, PAPER.planning, at=Instant(40, 4.0))
    assert chain[-1].text == "Without it there is no path at all."


def test_a_failure_in_the_same_query_makes_an_edge_dearer() -> None:
    made = choice(runs.timeline(), 1, 2, Planning(belief_weight=0.0, failure_penalty=0.4), at=Instant(60, 6.0))
    assert made is not None
    assert (made.penalty, made.faithful) == (0.4, True)


def test_other_thresholds_than_the_runs_are_said() -> None:
    made = choice(runs.timeline(), 0, 1, ROBUST.planning)
    assert made is not None
    assert not made.faithful
    assert any("Planning again" in reason.text for reason in blame.chosen(runs.timeline(), 0, 1, ROBUST.planning))


def test_an_edge_no_plan_led_through_was_not_chosen() -> None:
    (reason,) = blame.chosen(runs.timeline(), 7, 8, PAPER.planning)
    assert reason.kind is ReasonKind.NEVER


def test_every_choice_of_a_real_drive_costs_again_what_was_recorded() -> None:
    timeline = Timeline.of(Recording.open(DRIVE).events)
    edges = list(dict.fromkeys(edge for plan in timeline.plans for edge in plan.edges))[::4]
    for edge in edges:
        made = choice(timeline, *edge, ROBUST.planning)
        assert made is not None
        assert made.faithful
        assert made.without.cost >= made.again.cost


def test_a_missing_edge_is_missing_because_of_a_threshold() -> None:
    gates = Gates.building(PAPER.building)
    texts = [reason.text for reason in blame.missing(runs.timeline(), 0, 2, seen=(0.9, 2.0), gates=gates)]
    assert texts == [
        "There never was an edge 0 -> 2.",
        "The network would not join them: d = 2.00 is not below D_c = 1.50.",
    ]
    allowed = blame.missing(runs.timeline(), 0, 2, seen=(0.9, 0.5), gates=gates)[-1].text
    assert allowed.startswith("The network would join them")


def test_a_missing_edge_is_missing_because_a_node_is_only_in_the_reserve() -> None:
    run = [*runs.square(), *runs.at(10, GraphChanged(FramesReserved((8,), Cause.BUILD)))]
    assert [reason.text for reason in blame.missing(Timeline.of(run), 1, 8)] == [
        "There never was an edge 1 -> 8.",
        "Node 8 is not in the map, only in the reserve.",
    ]


def test_the_way_back_is_named_and_a_pruned_edge_is_gone_rather_than_missing() -> None:
    assert blame.missing(runs.timeline(), 1, 0)[-1].text == "The way back is there: edge 0 -> 1."
    assert blame.missing(runs.timeline(), 1, 2)[-1].kind is ReasonKind.GONE


def test_a_node_is_here_because_the_map_was_built_and_serves_plans() -> None:
    texts = [reason.text for reason in blame.node_here(Timeline.of(Recording.open(DRIVE).events), 921)]
    assert texts[0] == "Node 921 came in when the map was built."
    assert texts[1].startswith("It was joined with ")
    assert "plans led through it" in texts[2]


def test_a_node_is_here_because_there_was_no_path_or_nobody_recognised_the_place() -> None:
    expanded = [
        *runs.square(),
        *runs.at(20, QueryStarted(3, 0), runs.localised(3, 20, 2)),
        *runs.at(20, runs.node(8, cause=Cause.EXPAND), runs.edge(8, 2, cause=Cause.EXPAND)),
        *runs.at(20, runs.edge(2, 8, cause=Cause.EXPAND), Planned(3, (2, 8, 0), 2.0)),
        *runs.at(30, runs.localised(3, 30, None), runs.localised(3, 32, None)),
        *runs.at(32, runs.node(32, cause=Cause.NOVEL), runs.edge(32, 1, cause=Cause.NOVEL)),
    ]
    timeline = Timeline.of(expanded)
    assert [reason.text for reason in blame.node_here(timeline, 8)] == [
        "Node 8 came in because there was no path without it.",
        "In query 3 no path led from node 2 to 0; a way through image 8 did.",
        "It was joined with 1 node: 2.",
        "1 plan led through it, the last one in query 3.",
    ]
    assert blame.node_here(timeline, 32)[1].text == "In query 3 the robot had not recognised anything in 2 looks."


def test_a_picture_that_never_was_a_node_says_so() -> None:
    assert [reason.kind for reason in blame.node_here(runs.timeline(), 77)] == [ReasonKind.NEVER]


@pytest.mark.parametrize("length", [0, 1, 5, 14, 23, 30])
def test_a_recording_cut_anywhere_still_gives_answers(length: int) -> None:
    timeline = Timeline.of(runs.two_failures()[:length])
    for chain in (
        blame.gone(timeline, 1, 2),
        blame.weak(timeline, 1, 2),
        blame.missing(timeline, 1, 2),
        blame.chosen(timeline, 1, 2, PAPER.planning),
        blame.node_here(timeline, 1),
    ):
        assert all(reason.text for reason in chain)
        assert chain
