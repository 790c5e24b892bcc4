"""Presence of an edge over time: what was observed, what is expected, and what it would be like at another time."""

import itertools

import pytest

from examples.presence_plugin.presence_filters import FREMEN
from ltvn_core.analysis import presence_forecast as h
from ltvn_core.analysis import world_clock as clock
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.plan_explanation import PresenceDecision, explain_decision, presence_decision
from ltvn_core.analysis.replanning import Moment, Rules, moment_at, replan
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.what_if_changes import format_what_if_change, parse_what_if_change
from ltvn_core.config import ROBUST
from ltvn_core.errors import OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.presence.edge_presence import FilteredPresence, plan_by_presence
from ltvn_core.graph.presence.presence_filter import PERSISTENT, PresenceObservation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, Localised, Planned, QueryStarted, StampedEvent, WorldChanged
from ltvn_core.worlds import DoorMoved, TimePassed
from tests.core.evaluation.ground_truth_map import map_with_edges
from tests.core.graph.small_maps import edge_added, node_added

RULES = Rules(ROBUST, presence_filter=PERSISTENT)
CLOSED_TWICE = [PresenceObservation(present=False, stamp_s=float(at)) for at in (100, 700)]
OPENED = [*CLOSED_TWICE, PresenceObservation(present=True, stamp_s=4000.0)]


def run_with(observations: list[PresenceObservation]) -> list[StampedEvent]:
    """Return the events of a map of one edge that was observed now and then."""
    deltas = node_added(1), node_added(2), edge_added(1, 2, 0.6)
    events = [StampedEvent(0, 0.0, GraphChanged(delta)) for delta in deltas]
    for number, (present, at_s) in enumerate(observations):
        seen = d.PresenceObserved(1, 2, present=present, stamp=at_s, cause=d.Cause.ATTEMPT)
        events.append(StampedEvent(int(at_s * 10), at_s, GraphChanged(seen, query=0, attempt=number)))
    return events


def test_what_was_observed_of_an_edge_is_found_in_its_recording() -> None:
    timeline = Timeline.of(run_with(OPENED))
    found = edge_story(timeline, 1, 2).looks
    assert [each.seen for each in found] == OPENED
    assert [each.attempt for each in found] == [0, 1, 2]
    assert edge_story(timeline, 1, 2, found[1].instant).looks == found[:2]
    assert not edge_story(timeline, 2, 1).looks


def test_the_strip_tells_what_was_known_at_each_time_and_not_later() -> None:
    times_s = [0.0, 101.0, 701.0, 3999.0, 4001.0]
    found = h.presence_over_time(OPENED, PERSISTENT, times_s)
    assert [*map(h.presence_state, found)] == ["open", "closed", "closed", "unknown", "open"]
    assert h.presence_over_time(CLOSED_TWICE, PERSISTENT, times_s[:4]) == found[:4]


def test_a_closed_edge_is_expected_back_and_an_open_one_is_not() -> None:
    back_s = h.expected_open_s(CLOSED_TWICE, PERSISTENT, 701.0)
    assert back_s is not None
    found = h.presence_over_time(CLOSED_TWICE, PERSISTENT, [back_s * 0.8, back_s * 1.1])
    before, after = map(h.presence_state, found)
    assert (before, after) == (h.PresenceState.UNKNOWN, h.PresenceState.OPEN)
    assert h.expected_open_s(OPENED, PERSISTENT, 4001.0) is None


def test_another_hour_is_another_answer_where_something_happens_every_day() -> None:
    graph = TopologicalGraph([each.event.delta for each in run_with([]) if isinstance(each.event, GraphChanged)])
    for hour in range(96):
        open_now = 8 <= hour % 24 < 20
        graph.apply(d.PresenceObserved(1, 2, present=open_now, stamp=hour * 3600.0, cause=d.Cause.SIGHT))
    noon, night = (h.presence_as_if(graph, FREMEN, (96 + hour) * 3600.0)[1, 2] for hour in (14, 26))
    assert noon > 0.7 > 0.3 > night


HOUR = 3600.0
EIGHT = 8 * HOUR


def through_the_door(around: float) -> list[GraphChanged]:
    """Return a map with a way 0, 1, 2 by the door 1 -> 2, and one by 3 that is `around` long."""
    ways = ((0, 1, 0.5), (1, 2, 0.5), (0, 3, around / 2), (3, 2, around / 2), (1, 0, 0.5))
    return [GraphChanged(delta) for delta in (*map(node_added, range(4)), *(edge_added(*way, p=0.99) for way in ways))]


def run(around: float, waited_s: float) -> Timeline:
    """Return a run in which the door is seen blocked at 8:00:10, and a plan is made `waited_s` after that."""
    events = [StampedEvent(0, 0.0, event) for event in through_the_door(around)]
    events.append(StampedEvent(0, 0.0, WorldChanged(TimePassed(0.0), at_s=EIGHT)))
    blocked = d.PresenceObserved(1, 2, present=False, stamp=EIGHT + 10.0, cause=d.Cause.ATTEMPT)
    events.append(StampedEvent(100, 10.0, QueryStarted(0, 2)))
    events.append(StampedEvent(100, 10.0, GraphChanged(blocked, query=0, attempt=0)))
    events.append(StampedEvent(110, 11.0, WorldChanged(TimePassed(waited_s), at_s=EIGHT + 11.0 + waited_s)))
    events.append(StampedEvent(120, 12.0, QueryStarted(1, 2)))
    events.append(StampedEvent(120, 12.0, Localised(1, 120, 0, 0.1, 0.9, None, 0.5, "global")))
    timeline = Timeline.of(events)
    graph = timeline.graph_at()
    open_now = FilteredPresence(PERSISTENT).probabilities(
        graph, clock.world_time_at(timeline, timeline.instant(len(events) - 1))
    )
    planner = Planner(graph, ROBUST.planning)
    path = plan_by_presence(planner, 0, 2, {}, open_now, belief_weight=ROBUST.planning.belief_weight)
    timeline.append_event(StampedEvent(121, 12.1, Planned(1, path.nodes, path.cost)))
    return timeline


def decision(timeline: Timeline) -> PresenceDecision:
    """Return what its last plan chose between."""
    made = presence_decision(timeline, timeline.plans[-1], RULES)
    assert made is not None
    return made


def test_a_try_that_saves_much_is_explained_in_numbers() -> None:
    made = decision(run(around=12.0, waited_s=60.0))
    said = " ".join(explain_decision(made))
    assert made.tried
    assert made.follows_rule
    assert made.tries == 0
    assert made.edge == (1, 2)
    assert made.expected_cost < made.around.cost
    assert f"p = {made.p:.2f}" in said
    assert f"{made.expected_saving:.2f} less than going around" in said
    assert "day 1, 08:01" in said


def test_going_around_is_explained_too_where_a_try_is_not_worth_it() -> None:
    made = decision(run(around=1.6, waited_s=60.0))
    assert not made.tried
    assert made.follows_rule
    assert made.expected_saving < 0
    assert "went around" in " ".join(explain_decision(made))


def test_an_edge_that_is_probably_open_by_now_is_driven_like_any_other() -> None:
    made = decision(run(around=3.0, waited_s=30 * 24 * HOUR))
    assert made.tried
    assert made.counts_as_open
    assert "so it counted as open" in " ".join(explain_decision(made))


def test_a_plan_on_whose_way_nothing_was_seen_blocked_needs_no_explanation() -> None:
    timeline = run(around=0.8, waited_s=60.0)
    assert presence_decision(timeline, timeline.plans[-1], RULES) is None


def test_later_the_door_is_probably_open_and_the_plan_leads_through_it() -> None:
    timeline = run(around=1.6, waited_s=60.0)
    later = [parse_what_if_change("in 2 d")]
    now, then = (replan(moment_at(timeline), changes, RULES) for changes in ((), later))
    assert now.path.nodes == (0, 3, 2)
    assert then.path.nodes == (0, 1, 2)
    assert now.open_edges[1, 2] < 0.5 < then.open_edges[1, 2]
    assert "day 3, 08:01" in " ".join(then.notes)


def test_without_presence_a_later_time_changes_nothing_and_says_so() -> None:
    moment = Moment(TopologicalGraph([each.delta for each in through_the_door(3.0)]), 0, 2)
    now, then = (replan(moment, changes, RULES) for changes in ((), [parse_what_if_change("at 18:00")]))
    assert (now.path, now.edges) == (then.path, then.edges)
    assert "time changes nothing" in then.notes[0]


@pytest.mark.parametrize("text", ["at 18:00", "at day 2 07:30", "in 30 min", "in 1 h", "in 2 d"])
def test_a_time_is_written_as_it_is_read(text: str) -> None:
    assert format_what_if_change(parse_what_if_change(text)) == text


@pytest.mark.parametrize("text", ["at 25:00", "at 12:61", "at noon", "in an hour", "at day 0 12:00"])
def test_what_is_no_time_is_answered_with_what_is(text: str) -> None:
    with pytest.raises(OptionError, match="at 18:00"):
        parse_what_if_change(text)


def test_a_time_of_day_is_the_next_one_ahead() -> None:
    now = 24 * HOUR + 12 * HOUR
    assert clock.clock_text(clock.time_ahead(clock.parse_world_time("at 18:00"), now)) == "day 2, 18:00"
    assert clock.clock_text(clock.time_ahead(clock.parse_world_time("at 8:00"), now)) == "day 3, 08:00"
    with pytest.raises(OptionError, match="already"):
        clock.time_ahead(clock.parse_world_time("day 1 9:00"), now)


def test_the_clock_of_the_world_goes_on_while_that_of_the_robot_stands_still() -> None:
    timeline = run(around=3.0, waited_s=HOUR)
    times = [clock.world_time_at(timeline, timeline.instant(number)) for number in range(len(timeline.events))]
    assert all(earlier <= later for earlier, later in itertools.pairwise(times))
    assert times[-1] == pytest.approx(EIGHT + 12.1 + HOUR)


def test_a_map_where_nothing_was_seen_blocked_differs_by_what_is_closed_in_the_other() -> None:
    timeline = run(around=3.0, waited_s=1.0)
    here, there = timeline.graph_at(), TopologicalGraph([each.delta for each in through_the_door(3.0)])
    same = {edge: edge for edge in there.edges}
    now, before = (h.presence_as_if(graph, PERSISTENT, at) for graph, at in ((here, EIGHT + 20), (there, 0.0)))
    (change,) = h.presence_changes(before, now, same)
    assert change.edge == (1, 2)
    assert change.now < 0.5 < change.before == 1.0


def test_doors_count_as_the_world_and_not_as_presence() -> None:
    events = [StampedEvent(1, 1.0, WorldChanged(DoorMoved(0, is_open=False), at_s=50.0))]
    timeline = Timeline.of(events)
    assert clock.world_time_at(timeline, timeline.instant(0)._replace(stamp=4.0)) == pytest.approx(53.0)
    assert timeline.progress_before(1).seen_blocked == 0


def test_an_edge_that_left_the_map_is_blocked_no_longer() -> None:
    blocked = d.PresenceObserved(1, 2, present=False, stamp=5.0, cause=d.Cause.SIGHT)
    made = [GraphChanged(delta) for delta in map_with_edges((1, 2), (2, 1), (5, 6)).deltas()]
    for leaves in (d.EdgePruned(1, 2, d.Cause.ATTEMPT), d.NodeDropped(2, d.Cause.HAND), made[0].delta):
        events = [*made, GraphChanged(blocked), GraphChanged(leaves)]
        timeline = Timeline.of(StampedEvent(step, float(step), event) for step, event in enumerate(events))
        assert timeline.progress_before(len(events) - 1).blocked == {(1, 2)}
        assert (1, 2) not in timeline.graph_at().presence
        assert timeline.progress_before(len(events)).blocked == set()
