"""An event is put into words once, and everybody shows these words."""

import math
from typing import get_args

import pytest
import rerun as rr

from ltvn_core import worlds as w
from ltvn_core.analysis.failure_triage import failed_queries
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.event_drawing import draw_event
from ltvn_core.graph import deltas as d
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_text import describe_delta, describe_event
from tests.core.analysis import example_runs as runs

HERE = d.PoseRow(0.0, 0.0, 0.0)
BELIEF = d.Belief(0.8, 1.0, 0.1)
DELTAS: tuple[d.GraphDelta, ...] = (
    d.NodeAdded(d.Node(4, HERE), d.Cause.EXPAND),
    d.NodeDropped(4, d.Cause.HAND),
    d.EdgeAdded(d.Edge(1, 2, HERE, BELIEF), d.Cause.NOVEL),
    d.BeliefUpdated(1, 2, BELIEF, 3, 1, d.Cause.ATTEMPT),
    d.EdgePruned(1, 2, d.Cause.ATTEMPT),
    d.EdgeProtected(1, 2, False, d.Cause.HAND),
    d.EdgeActionSet(1, 2, "Open the door", d.Cause.HAND),
    d.PresenceObserved(1, 2, False, 3.0, d.Cause.ATTEMPT),
    d.NodeNamed(4, "kitchen", True, d.Cause.HAND),
    d.DriveBegun(40, "tuesday.rrd", d.Cause.ONLINE),
    d.FramesReserved((5, 6), d.Cause.ONLINE),
    d.FramesReleased((5,), d.Cause.EXPAND),
)
EVENTS: tuple[e.Event, ...] = (
    e.StateChanged(e.NavigatorState.DRIVING),
    e.QueryStarted(3, 9),
    e.Localised(3, 20, 4, 0.3, 0.95, 7, 0.2, "local"),
    e.Planned(3, (4, 7, 9), 2.5),
    e.AttemptStarted(3, 1, 4, 7, 20, HERE, 0.9),
    e.AttemptEnded(3, 1, 4, 7, 25, e.AttemptEnd.BLOCKED, 1.0, 0.2, False, "not connectable"),
    e.Collided(3, 2),
    e.GraphChanged(DELTAS[4]),
    e.QueryEnded(3, 9, e.Outcome.NO_PATH, 40, 1, 3.2),
    e.Judged(3, False, 2.0, 0.1),
    e.Note("The battery is low.", e.Severity.WARN),
    e.ActionBegun(3, 4, 7, 25, "Open the door"),
    e.ActionEnded(3, 4, 7, 60, False, "it could not be done"),
    e.WorldChanged(w.DoorMoved(2, is_open=False), e.ChangedBy.HAND, 36_000.0, w.Outline(1.0, 2.0, 0.0, 0.9, 0.1, 2.0)),
)

REACHED = e.AttemptEnded(3, 1, 4, 7, 25, e.AttemptEnd.REACHED, 0.1, 0.9, False, "driven too often")


def test_there_is_an_example_of_each_kind() -> None:
    assert {type(event) for event in EVENTS} == set(get_args(e.Event))
    assert {type(delta) for delta in DELTAS} == set(get_args(d.GraphDelta))


@pytest.mark.parametrize(
    ("event", "text", "severity"),
    [
        (EVENTS[1], "query 3 started: node 9 is the goal", "INFO"),
        (EVENTS[2], "at node 4: distance 0.30, reachability 0.95, margin 0.20 to node 7 (local)", "INFO"),
        (EVENTS[3], "plan of 3 nodes, cost 2.50: 4 → 7 → 9", "INFO"),
        (EVENTS[5], "attempt 1 along edge 4 → 7 failed (blocked): not connectable", "WARN"),
        (REACHED, "attempt 1 along edge 4 → 7 failed, though it got there: driven too often", "WARN"),
        (EVENTS[6], "collision 2 of query 3", "WARN"),
        (EVENTS[7], "edge 1 → 2 pruned (attempt)", "WARN"),
        (EVENTS[8], "query 3 ended: no path after 40 steps, 3.2 m, 1 collision", "INFO"),
        (EVENTS[9], "query 3 judged: goal missed, 2.00 m and 0.10 rad away", "ERROR"),
        (EVENTS[10], "The battery is low.", "WARN"),
    ],
)
def test_an_event_says_what_happened_and_how_bad_it_is(event: e.Event, text: str, severity: str) -> None:
    assert (describe_event(event).text, describe_event(event).severity) == (text, severity)


@pytest.mark.parametrize("delta", DELTAS, ids=lambda delta: type(delta).__name__)
def test_a_change_of_the_map_names_its_cause(delta: d.GraphDelta) -> None:
    assert describe_delta(delta).text.endswith(f"({delta.cause})")


def test_a_look_that_follows_places_says_how_sure_it_is() -> None:
    event = e.Localised(3, 20, 4, 0.3, 0.95, None, math.inf, "local", probability=0.31)
    assert describe_event(event).text == ("at node 4: distance 0.30, reachability 0.95, place probability 31% (local)")


def test_a_long_plan_is_told_by_its_first_and_last_nodes() -> None:
    text = describe_event(e.Planned(0, tuple(range(100, 160)), 31.0)).text
    assert text == "plan of 60 nodes, cost 31.00: 100 → 101 → 102 → 103 → 104 → 105 → ... → 159"


def test_log_marks_and_debugger_show_the_same_words() -> None:
    timeline = Timeline.of(runs.two_failures())
    collision = next(mark for mark in timeline.marks if mark.kind is MarkKind.COLLISION)
    event = timeline.events[collision.event].event
    logged = [part for row in draw_event(event, DrawnPoses()) for part in row.values if isinstance(part, rr.TextLog)]
    (failure,) = failed_queries(timeline)
    assert collision.text == describe_event(event).text
    assert logged[0].text is not None
    assert logged[0].text.as_arrow_array().to_pylist() == [collision.text]
    assert failure.text == describe_event(event).sentence


def test_furniture_of_a_scene_is_named_as_a_person_says_it() -> None:
    assert w.change_text(w.ThingRemoved("own/high-table-1")) == "high table 1 taken away"
    assert w.change_text(w.ThingReturned("my-box")) == "my-box put back"
