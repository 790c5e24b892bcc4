"""Every event has a row in the one table, and everybody shows its words."""

import math
from typing import Any, get_args

import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core import worlds as w
from ltvn_core.analysis.failure_triage import failed_queries
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.event_drawing import draw_event
from ltvn_core.graph import deltas as d
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_table import describe_delta, describe_event
from tests.core.analysis import example_runs as runs

ATTEMPT = (3, 1, 4, 7, 25)


@pytest.mark.parametrize("kind", [*get_args(e.Event), *get_args(d.GraphDelta)], ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_every_event_and_every_change_of_the_map_has_a_row(kind: type, data: st.DataObject) -> None:
    happened: Any = data.draw(st.from_type(kind))
    is_change = kind in get_args(d.GraphDelta)
    try:
        row = describe_delta(happened) if is_change else describe_event(happened)
    except AssertionError:
        pytest.fail(f"{kind.__name__} has no row: add a case to the table in ltvn_core/navigation/event_table.py")
    assert row.text.endswith(f"({happened.cause})") if is_change else row.text or kind is e.Note


@pytest.mark.parametrize(
    ("event", "text", "severity"),
    [
        (e.QueryStarted(3, 9), "query 3 started: node 9 is the goal", "INFO"),
        (
            e.Localised(3, 20, 4, 0.3, 0.95, 7, 0.2, "local"),
            "at node 4: distance 0.30, reachability 0.95, margin 0.20 to node 7 (local)",
            "INFO",
        ),
        (e.Planned(3, (4, 7, 9), 2.5), "plan of 3 nodes, cost 2.50: 4 → 7 → 9", "INFO"),
        (
            e.AttemptEnded(*ATTEMPT, e.AttemptEnd.BLOCKED, 1.0, 0.2, False, "not connectable"),
            "attempt 1 along edge 4 → 7 failed (blocked): not connectable",
            "WARN",
        ),
        (
            e.AttemptEnded(*ATTEMPT, e.AttemptEnd.REACHED, 0.1, 0.9, False, "driven too often"),
            "attempt 1 along edge 4 → 7 failed, though it got there: driven too often",
            "WARN",
        ),
        (e.Collided(3, 2), "collision 2 of query 3", "WARN"),
        (e.GraphChanged(d.EdgePruned(1, 2, d.Cause.ATTEMPT)), "edge 1 → 2 pruned (attempt)", "WARN"),
        (
            e.QueryEnded(3, 9, e.Outcome.NO_PATH, 40, 1, 3.2),
            "query 3 ended: no path after 40 steps, 3.2 m, 1 collision",
            "INFO",
        ),
        (
            e.Judged(3, False, 2.0, 0.1),
            "query 3 judged: goal missed, 2.00 m and 0.10 rad away",
            "ERROR",
        ),
        (e.Note("The battery is low.", e.Severity.WARN), "The battery is low.", "WARN"),
    ],
)
def test_an_event_says_what_happened_and_how_bad_it_is(event: e.Event, text: str, severity: str) -> None:
    assert (describe_event(event).text, describe_event(event).severity) == (text, severity)


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
