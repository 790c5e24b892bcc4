"""Presence of an edge over time: what was observed, what is expected, and what it would be like at another time."""

import pytest

from examples.presence_plugin.presence_filters import FREMEN
from ltvn_core.analysis.edge_presence_history import (
    PresenceState,
    expected_open_s,
    observed_presence,
    presence_as_if,
    presence_changes,
    presence_strip,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, Node, NodeAdded, PoseRow, PresenceObserved
from ltvn_core.graph.presence.observation import PresenceObservation
from ltvn_core.graph.presence.persistent import PERSISTENT
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent

CLOSED_TWICE = [PresenceObservation(present=False, stamp_s=float(at)) for at in (100, 700)]
OPENED = [*CLOSED_TWICE, PresenceObservation(present=True, stamp_s=4000.0)]


def run_with(observations: list[PresenceObservation]) -> list[StampedEvent]:
    """Return the events of a map of one edge that was observed now and then."""
    here = PoseRow(0.0, 0.0, 0.0)
    edge = Edge(1, 2, PoseRow(0.6, 0.0, 0.0), Belief(0.9, 0.6, 0.02))
    deltas = [
        NodeAdded(Node(1, here), Cause.BUILD),
        NodeAdded(Node(2, here), Cause.BUILD),
        EdgeAdded(edge, Cause.BUILD),
    ]
    events = [StampedEvent(0, 0.0, GraphChanged(delta)) for delta in deltas]
    for number, (present, at_s) in enumerate(observations):
        seen = PresenceObserved(1, 2, present=present, stamp=at_s, cause=Cause.ATTEMPT)
        events.append(StampedEvent(int(at_s * 10), at_s, GraphChanged(seen, query=0, attempt=number)))
    return events


def test_what_was_observed_of_an_edge_is_found_in_its_recording() -> None:
    timeline = Timeline.of(run_with(OPENED))
    found = observed_presence(timeline, 1, 2)
    assert [each.observation for each in found] == OPENED
    assert [each.attempt for each in found] == [0, 1, 2]
    assert observed_presence(timeline, 1, 2, found[1].instant) == found[:2]
    assert not observed_presence(timeline, 2, 1)


def test_the_strip_tells_what_was_known_at_each_time_and_not_later() -> None:
    strip = presence_strip(OPENED, PERSISTENT, [0.0, 101.0, 701.0, 3999.0, 4001.0])
    assert strip.states[0] is PresenceState.OPEN
    assert strip.states[1:3] == (PresenceState.CLOSED, PresenceState.CLOSED)
    assert strip.states[3] is PresenceState.UNKNOWN
    assert strip.states[4] is PresenceState.OPEN
    assert presence_strip(CLOSED_TWICE, PERSISTENT, strip.times_s[:4]).probabilities == strip.probabilities[:4]


def test_a_closed_edge_is_expected_back_and_an_open_one_is_not() -> None:
    back_s = expected_open_s(CLOSED_TWICE, PERSISTENT, 701.0)
    assert back_s is not None
    before, after = presence_strip(CLOSED_TWICE, PERSISTENT, [back_s * 0.8, back_s * 1.1]).states
    assert (before, after) == (PresenceState.UNKNOWN, PresenceState.OPEN)
    assert expected_open_s(OPENED, PERSISTENT, 4001.0) is None


def test_another_hour_is_another_answer_where_something_happens_every_day() -> None:
    graph = TopologicalGraph([each.event.delta for each in run_with([]) if isinstance(each.event, GraphChanged)])
    for hour in range(96):
        open_now = 8 <= hour % 24 < 20
        graph.apply(PresenceObserved(1, 2, present=open_now, stamp=hour * 3600.0, cause=Cause.SIGHT))
    daily = FREMEN
    noon, night = (presence_as_if(graph, daily, (96 + hour) * 3600.0)[1, 2] for hour in (14, 26))
    assert noon > 0.7 > 0.3 > night
    changed = presence_changes(graph, daily, (96 + 14) * 3600.0, (96 + 26) * 3600.0)
    assert [(each.edge, each.before, each.now) for each in changed] == [
        ((1, 2), pytest.approx(noon), pytest.approx(night))
    ]
