"""One pass over the events: what it finds, and what it makes of events that are cut, twice there or in disorder."""

import numpy as np
import pytest

from ltvn_core.analysis.timeline import Timeline, adjacent_instant, adjacent_mark
from ltvn_core.analysis.timeline_records import Instant, MarkKind
from ltvn_core.data.recording.reader import Recording
from ltvn_core.graph.deltas import Cause, EdgePruned, NodeDropped
from ltvn_core.navigation.events import GraphChanged, Outcome, Planned, QueryEnded, QueryStarted
from tests.core.analysis import example_runs as runs
from tests.repository import DEMO_DRIVE, DEMO_MAP


@pytest.fixture(scope="module")
def drive() -> Recording:
    return Recording.open(DEMO_DRIVE)


def test_a_real_drive_is_told_by_its_queries_attempts_and_changes(drive: Recording) -> None:
    timeline = Timeline.of(drive.events)
    assert [query.outcome for query in timeline.queries] == [Outcome.ARRIVED, Outcome.ARRIVED]
    assert sum(len(query.attempts) for query in timeline.queries) == len(timeline.attempts) == 51
    assert all(attempt.plan and attempt.plan.localised and attempt.ended for attempt in timeline.attempts)
    assert (len(timeline.changes), timeline.changes[-1].version) == (760, 760)
    assert timeline.notes == ()


def test_the_map_at_any_step_is_that_of_the_recording(drive: Recording) -> None:
    timeline = Timeline.of(drive.events)
    for step in (0, 1260, 1500, 1879):
        assert timeline.graph_at(Instant(step, 0.0)) == drive.graph_at(step)
    assert timeline.graph_at() == drive.final_graph()


def test_a_map_file_has_no_queries_and_one_map() -> None:
    timeline = Timeline.of(Recording.open(DEMO_MAP).events)
    assert (timeline.queries, timeline.epochs) == ((), (0,))
    assert [mark.kind for mark in timeline.marks] == [MarkKind.MAP]


def test_marks_tell_what_a_slider_should_show() -> None:
    marks = [(mark.kind, mark.instant.step) for mark in runs.timeline().marks]
    assert (MarkKind.PRUNE, 140) in marks
    assert (MarkKind.COLLISION, 55) in marks
    assert [step for kind, step in marks if kind is MarkKind.FAILURE] == [60, 80, 140]
    assert [step for kind, step in marks if kind is MarkKind.REPLAN] == [160]
    assert [step for kind, step in marks if kind in (MarkKind.QUERY_START, MarkKind.QUERY_END)] == [20, 80, 100, 180]


def test_one_can_step_by_mark_by_event_and_by_query() -> None:
    timeline, start = runs.timeline(), Instant(20, 2.0)
    prune = adjacent_mark(timeline, start, MarkKind.PRUNE, forwards=True)
    assert prune is not None
    assert (prune.ids, prune.instant.step) == ((1, 2), 140)
    assert adjacent_mark(timeline, prune.instant, MarkKind.PRUNE, forwards=True) is None
    back = adjacent_mark(timeline, prune.instant, None, forwards=False)
    assert back is not None
    assert back.instant.step == 100
    assert adjacent_instant(timeline, start, forwards=True) == Instant(40, 4.0)
    assert adjacent_instant(timeline, start, forwards=False) == Instant(10, 1.0)
    assert adjacent_instant(timeline, Instant(10, 1.0), forwards=False) is None
    later = adjacent_mark(timeline, start, MarkKind.QUERY_START, forwards=True)
    assert later is not None
    assert later.instant.step == 100
    assert adjacent_mark(timeline, later.instant, MarkKind.QUERY_START, forwards=True) is None
    earlier = adjacent_mark(timeline, later.instant, MarkKind.QUERY_START, forwards=False)
    assert earlier is not None
    assert earlier.instant.step == 20


def test_an_attempt_to_a_subgoal_farther_ahead_drives_all_edges_on_the_way() -> None:
    far = runs.attempt_started(0, 1, 0, 2, 20)
    run = [*runs.square(), *runs.at(20, QueryStarted(0, 2), Planned(0, (0, 1, 2), 2.0), far)]
    assert Timeline.of(run).attempts[0].edges == ((0, 1), (1, 2))


def test_events_in_disorder_are_put_in_order_and_a_note_says_so() -> None:
    run = runs.two_failures()
    mixed = [*run[:20], *run[30:], *run[20:30]]
    timeline = Timeline.of(mixed)
    assert list(timeline.events) == run
    assert any("after a later one" in note for note in timeline.notes)


def test_a_query_that_is_cut_has_no_end_and_neither_failed_nor_succeeded() -> None:
    run = [stamped for stamped in runs.two_failures() if stamped.step <= 60]
    (query,) = Timeline.of(run).queries
    assert (query.end, query.outcome, query.succeeded) == (None, None, None)
    assert query.attempts[-1].ended is None
    assert "Query 0 is cut" in Timeline.of(run).notes[0]


def test_a_query_begun_before_the_last_one_ended_cuts_it() -> None:
    run = [stamped for stamped in runs.two_failures() if not isinstance(stamped.event, QueryEnded) or stamped.step > 80]
    first, second = Timeline.of(run).queries
    assert (first.succeeded, second.succeeded) == (None, True)
    assert first.last < second.first


def test_ends_without_a_beginning_are_left_out_with_a_note() -> None:
    timeline = Timeline.of([stamped for stamped in runs.two_failures() if stamped.step > 120])
    assert (timeline.queries, len(timeline.attempts)) == ((), 1)
    assert len(timeline.notes) == 3


def test_a_second_map_begins_a_new_epoch_and_time_travel_does_not_mix_them() -> None:
    second = [runs.node(frame, cause=Cause.LOAD) for frame in (0, 7)] + [runs.edge(0, 7, cause=Cause.LOAD)]
    third = [runs.node(0, cause=Cause.LOAD)]
    timeline = Timeline.of([*runs.two_failures(), *runs.at(200, *second), *runs.at(201, *third)])
    assert len(timeline.epochs) == 3
    assert set(timeline.graph_at(Instant(190, 0.0)).nodes) == {0, 1, 2, 3}
    assert set(timeline.graph_at(Instant(200, 0.0)).edges) == {(0, 7)}
    assert set(timeline.graph_at().nodes) == {0}
    assert [mark.instant.step for mark in timeline.marks if mark.kind is MarkKind.MAP] == [10, 200, 201]


def test_of_a_map_alone_the_images_of_its_drive_are_shown_with_the_map_from_the_first_on() -> None:
    loaded = runs.at(20, runs.node(0, cause=Cause.LOAD), runs.node(10, cause=Cause.LOAD))
    seen = [(step, step / 10, np.array([step, 0.0, 0.0])) for step in (0, 10, 20)]
    timeline = Timeline.of(loaded, seen)
    assert (timeline.start_s, timeline.end_s, len(timeline.frames)) == (0.0, 2.0, 3)
    assert set(timeline.graph_at(timeline.instant_at(0.0)).nodes) == {0, 10}
    driven_on = Timeline.of(loaded, [*seen, (30, 3.0, np.zeros(3))])
    assert (driven_on.start_s, len(driven_on.frames)) == (3.0, 1)


def test_edges_added_and_pruned_are_counted_anew_for_a_new_map() -> None:
    make = runs
    pruned = GraphChanged(EdgePruned(1, 2, Cause.ATTEMPT))
    events = [
        *make.at(0, make.node(1), make.node(2), make.edge(1, 2)),
        *make.at(1, make.edge(2, 1, cause=Cause.ATTEMPT), pruned),
        *make.at(2, make.node(3)),
    ]
    timeline = Timeline.of(events)
    counts = [(then.added, then.pruned) for then in map(timeline.progress_before, range(len(events) + 1))]
    assert counts[-2:] == [(1, 1), (0, 0)]


def test_nothing_at_all_is_a_timeline_too() -> None:
    timeline = Timeline.of([])
    assert adjacent_instant(timeline, Instant(0, 0.0), forwards=True) is None
    assert adjacent_mark(timeline, Instant(0, 0.0), None, forwards=True) is None
    assert timeline.query_at(0) is None
    assert len(timeline.graph_at().nodes) == 0


def test_time_travel_to_and_fro_over_many_changes_gives_the_same_maps_and_none_spoils_another() -> None:
    nodes = [runs.at(step, runs.node(step, cause=Cause.ONLINE)) for step in range(25_000)]
    fresh = runs.at(25_000, runs.node(0, cause=Cause.LOAD), runs.node(1, cause=Cause.LOAD))
    timeline = Timeline.of([*(stamped for row in nodes for stamped in row), *fresh])
    for step in (24_999, 10_000, 9_999, 3, 20_000, 24_999):
        graph = timeline.graph_at(Instant(step, 0.0))
        assert (len(graph.nodes), graph.version) == (step + 1, step + 1)
        graph.apply(NodeDropped(0, Cause.HAND))
    assert (len(timeline.graph_at().nodes), timeline.graph_at().version) == (2, 2)
