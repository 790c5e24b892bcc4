"""The page's timeline: every notable event is marked once and in order, and time goes back, on, and back to now."""

import json
from itertools import pairwise

import numpy as np
import pytest

from ltvn_core.analysis.timeline import Timeline, adjacent_instant
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.data.recording.reader import Recording
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_table import MarkKind
from ltvn_core.navigation.events import GraphChanged, Outcome, StampedEvent, WorldChanged
from ltvn_core.types import CONTROL_STEP_S, Twist
from ltvn_core.worlds import DoorMoved, PersonMoved
from ltvn_viz.panels.replay_panel import TimelinePanel
from ltvn_viz.server.strip_kinds import BAR_STYLES, STRIP_STYLES, QueryEnd, StripKind, strip_tables
from ltvn_viz.session.snapshot import Snapshot, TimelineStatus
from ltvn_viz.timeline.strip_marks import STRIP_NUMBERS, StripLibrary, StripMarks, StripRow
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action, Ask
from tests.core.analysis import example_runs
from tests.repository import DEMO_FAULT
from tests.viz.session_harness import SessionHarness, said


def rows_of(run: Timeline) -> list[StripRow]:
    strip = StripMarks(run)
    strip.take_in(run)
    return strip.rows


def test_of_a_recording_with_faults_queries_failures_and_the_prune_are_marked_in_order() -> None:
    run = Timeline.of(Recording.open(DEMO_FAULT).events)
    rows = rows_of(run)
    kinds = [kind for _, kind, *_ in rows]
    assert kinds.count(MarkKind.QUERY_START) == 4
    assert [row[3] for row in rows if row[1] == MarkKind.QUERY_END] == [
        QueryEnd.FAILED,
        QueryEnd.FAILED,
        QueryEnd.REACHED,
        QueryEnd.WRONG,  # The verdict on the query before it.
        QueryEnd.FAILED,
    ]
    assert [row[2:] for row in rows if row[1] == MarkKind.PRUNE] == [(1489, 2621)]
    assert kinds.count(MarkKind.FAILURE) == 7
    assert MarkKind.ADD not in kinds  # The whole map that came in at first is no news.
    assert all(before[0] <= after[0] for before, after in pairwise(rows))


def test_doors_and_what_was_learned_by_hand_are_marked() -> None:
    run = Timeline.of(
        [
            *example_runs.square(),
            *example_runs.at(20, WorldChanged(DoorMoved(3, is_open=False))),
            *example_runs.at(30, WorldChanged(DoorMoved(3, is_open=True))),
        ]
    )
    assert [row[1:3] for row in rows_of(run)[-2:]] == [(MarkKind.DOOR_CLOSED, 3), (MarkKind.DOOR_OPENED, 3)]


def test_a_page_that_has_some_rows_is_given_the_others_and_a_run_in_another_order_is_another_run() -> None:
    library, run = StripLibrary(), example_runs.timeline()
    number, count = library.of(run)
    whole = json.loads(library.rows_from(number * STRIP_NUMBERS) or b"")
    rest = json.loads(library.rows_from(number * STRIP_NUMBERS + 3) or b"")
    assert (len(whole["rows"]), rest["first"], rest["rows"]) == (count, 3, whole["rows"][3:])
    run.append_event(StampedEvent(1, CONTROL_STEP_S, example_runs.ended(0, 1, Outcome.CANCELLED)))
    other, _ = library.of(run)
    assert other != number
    assert library.rows_from(99 * STRIP_NUMBERS) is None


def test_every_kind_of_mark_has_a_sign_of_its_own_and_the_page_knows_it() -> None:
    marks = {*StripKind, *MarkKind} - {MarkKind.QUERY_START, MarkKind.QUERY_END, MarkKind.MAP, MarkKind.EXPAND}
    assert set(STRIP_STYLES) == marks
    assert set(BAR_STYLES) == set(QueryEnd)
    assert len({style.sign for style in STRIP_STYLES.values()}) == len(marks)
    assert len({style.sign for style in BAR_STYLES.values()}) == len(BAR_STYLES)
    json.dumps(strip_tables())


@pytest.mark.parametrize(("is_now", "least", "most"), [(False, 9, 11), (True, 2, 3)])
def test_a_moment_is_told_once_and_time_that_only_goes_on_now_and_then(is_now: bool, least: int, most: int) -> None:
    told: list[str] = []
    now = [0.0]
    panel = TimelinePanel(told.append, lambda: now[0])
    for tick in range(31):
        now[0] = tick / 30
        panel.show(Snapshot(timeline=TimelineStatus(run=1, time_s=now[0], length_s=9.0, is_now=is_now)))
    assert least <= len(told) <= most
    panel.show(Snapshot(timeline=TimelineStatus(run=1, time_s=now[0] + 0.01, length_s=9.0, is_playing=True)))
    assert json.loads(told[-1])["playing"] is True
    before = len(told)
    now[0] += 1.0
    panel.show(Snapshot(timeline=TimelineStatus(run=1, time_s=1.01, length_s=9.0, is_playing=True)))
    assert len(told) == before


def do(harness: SessionHarness, action: Action, target: int | None = None) -> TimelineStatus:
    return harness.do(Ask(action, target)).timeline


def test_a_look_back_at_the_live_run_plays_on_until_it_is_now(harness: SessionHarness) -> None:
    harness.wait(90)
    length_s = harness.now.timeline.length_s
    assert harness.now.timeline.is_now
    back = do(harness, Action.SEEK, round(1000 * (length_s - 1.0)))
    assert (back.is_now, back.is_playing) == (False, False)
    assert "shows the past" in harness.now.hint
    assert back.time_s == pytest.approx(length_s - 1.0, abs=0.002)
    assert do(harness, Action.SPEED, 800).speed == 8.0
    assert do(harness, Action.PLAY).is_playing
    assert harness.wait(30).timeline.is_now
    assert not harness.now.timeline.is_playing


def test_looking_back_ends_with_one_press_and_whenever_somebody_drives(harness: SessionHarness) -> None:
    harness.wait(60)
    assert not do(harness, Action.SEEK, 500).is_now
    assert do(harness, Action.SHOW_NOW).is_now
    assert not do(harness, Action.SEEK, 500).is_now
    harness.driver.twist = Twist(0.3, 0.0)
    assert harness.wait(2).timeline.is_now


def test_a_person_is_told_that_now_cannot_be_played(harness: SessionHarness) -> None:
    harness.wait(5)
    shown = harness.do(c.Ask(c.Action.PLAY))
    assert "look back" in said(shown)


def test_new_edges_of_a_drive_come_in_one_by_one_and_are_marked(harness: SessionHarness) -> None:
    events = [stamped.event for stamped in harness.state.live.timeline.events]
    assert any(isinstance(event, GraphChanged) for event in events)
    number, count = harness.state.strips.of(harness.state.live.timeline)
    assert number == 1
    assert count == len(rows_of(harness.state.live.timeline))


def test_back_from_a_robot_that_stands_the_last_thing_that_happened_comes_first() -> None:
    run = example_runs.timeline()
    last = run.instant(len(run.events) - 1)
    later = Instant(last.step, last.stamp + 60.0)
    assert adjacent_instant(run, later, forwards=False) == last
    before = adjacent_instant(run, last, forwards=False)
    assert before is not None
    assert before.stamp < last.stamp


def test_where_a_person_drove_and_took_images_is_marked_while_the_robot_moves(harness: SessionHarness) -> None:
    run = harness.state.live.timeline
    strip = StripMarks(run)
    strip.take_in(run)
    before = len(strip.rows)
    harness.driver.twist = Twist(0.2, 0.0)
    harness.wait(60)
    harness.driver.twist = None
    strip.take_in(run)
    kinds = [row.kind for row in strip.rows[before:]]
    assert 5 <= kinds.count(StripKind.DRIVEN_BY_PERSON) <= 9
    assert 1 <= kinds.count(StripKind.RECORDED) <= 3
    harness.wait(60)
    known = len(strip.rows)
    strip.take_in(run)
    assert not {row.kind for row in strip.rows[known + 1 :]} & {StripKind.DRIVEN_BY_PERSON, StripKind.RECORDED}
    assert all(one.time_ms <= other.time_ms for one, other in pairwise(strip.rows))


def test_what_a_query_drove_is_not_what_a_person_drove() -> None:
    frames = [(step, step / 10, np.array([step / 10, 0.0, 0.0])) for step in range(60)]
    during = [*example_runs.at(20, e.QueryStarted(0, 3)), *example_runs.at(40, example_runs.ended(0, 3))]
    rows = rows_of(Timeline.of(during, frames))
    times = {kind: [row[0] / 1000 for row in rows if row[1] == kind] for kind in StripKind}
    assert all(2.0 < time <= 4.0 for time in times[StripKind.DRIVEN_BY_QUERY])
    assert any(time <= 2.0 for time in times[StripKind.DRIVEN_BY_PERSON])
    assert not any(2.0 < time <= 4.0 for time in times[StripKind.DRIVEN_BY_PERSON])


def test_plans_beliefs_and_people_are_marked_by_what_changed() -> None:
    plans = (e.Planned(0, nodes, 1.0) for nodes in ((1, 2, 3), (2, 3), (2, 4, 3), (), ()))
    beliefs = (example_runs.belief(*belief, (1, 0), (0, 1)) for belief in ((1, 2, 0.9), (2, 3, 0.2), (2, 3, 0.2)))
    people = (e.WorldChanged(PersonMoved("ann", (1.0, step, 0.0))) for step in range(20))
    edges = example_runs.edge(1, 2, p=0.8), example_runs.edge(2, 3, p=0.8)
    happened = *edges, e.QueryStarted(0, 3), *plans, *beliefs, *people
    assert [row[1:] for row in rows_of(Timeline.of(example_runs.at(10, *happened)))] == [
        (MarkKind.QUERY_START, 0, 3),
        (StripKind.PLANNED, 1, 3),
        (MarkKind.REPLAN, 2, 3),
        (StripKind.NO_PLAN, -1, -1),
        (StripKind.ROSE, 1, 2),
        (StripKind.FELL, 2, 3),
        (StripKind.PEOPLE_MOVED, -1, -1),
    ]
