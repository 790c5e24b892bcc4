"""Whatever is asked about a moment, all answers are about that moment, and name the same numbers."""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from ltvn_core import palette
from ltvn_core.analysis.answer import Answer, CalibrationChart, Paragraph, PresenceChart, StepChart, Table
from ltvn_core.analysis.answer_text import answer_text, line_text
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.deltas import Cause, GraphDelta, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation import events as e
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.worlds import DoorMoved, TimePassed
from ltvn_viz.debugger.compared_map import BEFORE_FIRST_QUERY
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.repository import DEMO_DRIVE, DEMO_FAULT, DEMO_MAP, RECORDINGS
from tests.viz.app_session import AppSession
from tests.viz.debugger.answer_links import answer_of, follow, links, words
from tests.viz.session_harness import SessionHarness

PRUNED, TRUSTED = (1489, 2621), (3081, 2226)
"""An edge that failed and was pruned, and one that was driven and believed more each time."""
EDGES: dict[str, tuple[EdgeKey, ...]] = {
    DEMO_FAULT.name: (PRUNED, TRUSTED),
    DEMO_DRIVE.name: ((1195, 1183), (492, 496)),
    DEMO_MAP.name: ((706, 1166),),
}
"""Edges to ask about in each tracked recording."""
_ROUNDING_S = 0.1
"""Times in text have one digit."""


class ReplayedFile(AppSession):
    """A tracked recording, open in a session; what was computed at one moment is there at the next, as in the page."""

    def __init__(self, stack: ExitStack, name: str) -> None:
        super().__init__(stack, AppOptions(recordings=RECORDINGS, replay=name))
        self.name = name
        self.do(c.OpenRecording(name), ticks=3)
        self.do(ticks=3)

    @property
    def timeline(self) -> Timeline:
        return self.state.shown_run

    @property
    def instant(self) -> Instant:
        return self.timeline.instant_at(self.now.moment.stamp)

    @property
    def now_s(self) -> float:
        return self.now.moment.stamp - self.timeline.start_s

    @property
    def known(self) -> int:
        return self.timeline.count_until(self.instant)

    @property
    def graph(self) -> TopologicalGraph:
        return self.timeline.graph_at(self.instant)

    def moments(self, count: int = 6) -> list[float]:
        length_s = self.timeline.end_s - self.timeline.start_s
        return np.unique(np.linspace(0.0, length_s, count)).tolist()

    def offers(self, question: QuestionName) -> bool:
        return question in self.now.inspection.offered

    def answer(self, question: QuestionName) -> Answer:
        shown = self.do(c.Ask(c.Action.QUESTION, question), ticks=3)
        for _ in range(60):
            if not shown.inspection.answer.answer.is_pending:
                break
            shown = self.do(ticks=2)
        return shown.inspection.answer.answer

    def tables(self, question: QuestionName) -> list[tuple[tuple[str, ...], list[list[str]]]]:
        tables = [block for block in self.answer(question).blocks if isinstance(block, Table)]
        return [(table.head, [[line_text(cell) for cell in row] for row in table.rows]) for table in tables]

    def rows(self, question: QuestionName) -> list[list[str]]:
        return [row for _, rows in self.tables(question) for row in rows]

    def text(self, question: QuestionName) -> str:
        self.answer(question)
        return words(self.now)

    def rows_about(self, question: QuestionName, edge: EdgeKey) -> list[list[str]]:
        return [row for row in self.rows(question) if row[0] == f"{edge[0]} → {edge[1]}"]

    def compare_with_the_beginning(self) -> None:
        offered = self.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE), ticks=3)
        found = [number for number, label in links(offered) if label == BEFORE_FIRST_QUERY]
        if found:
            self.do(c.Ask(c.Action.FOLLOW, found[0]), ticks=3)


@pytest.fixture(scope="module", params=EDGES)
def replay(request: pytest.FixtureRequest) -> Iterator[ReplayedFile]:
    """Each tracked recording, opened once for all tests of this file."""
    with ExitStack() as stack:
        yield ReplayedFile(stack, request.param)


def stated_beliefs(replay: ReplayedFile, edge: EdgeKey) -> dict[str, tuple[str, str]]:
    """What each answer that names p and length (mu) of the edge says of them."""
    stated = {}
    told = replay.text(QuestionName.EDGE)
    if found := re.search(r"p (\d\.\d\d) · length \(mu\) (\d+\.\d\d)", told):
        stated["edge"] = found[1], found[2]
    for verdict in ("still the first one: p = ", "counted, .* p went from .* to "):
        if found := re.search(rf"{verdict}(\d\.\d\d), length \(mu\) (?:= |from \d+\.\d\d to )(\d+\.\d\d)", told):
            stated["reasons"] = found[1], found[2]
    replay.do(c.PointAt(edge[0]), ticks=3)
    for row in replay.rows_about(QuestionName.EDGE, edge):
        stated["edges of the node"] = row[1], row[2]
    replay.do(c.PointAt(*edge), ticks=3)
    return stated


def stated_ps(replay: ReplayedFile, edge: EdgeKey) -> dict[str, str]:
    """What each answer that names p alone says of it."""
    stated = {}
    told = replay.answer(QuestionName.EDGE)
    if found := re.search(r"Why is (?:its belief so low, )?p = (\d\.\d\d)\?", answer_text(told)):
        stated["title of the reasons"] = found[1]
    for block in told.blocks:
        if isinstance(block, StepChart):
            stated["curve"] = f"{block.points[-1][1]:.2f}"
    for question in (QuestionName.COMPARE, QuestionName.TRUTH):
        if replay.offers(question):
            stated.update((question, row[1].split()[0]) for row in replay.rows_about(question, edge))
    graph = replay.now.moment.graph
    drawn = {(int(graph.ids[a]), int(graph.ids[b])): p for (a, b), p in zip(graph.edges, graph.p, strict=True)}
    if edge in drawn:
        stated["scene"] = f"{drawn[edge]:.2f}"
    return stated


def test_all_answers_about_an_edge_name_the_same_p_and_length_at_every_moment(replay: ReplayedFile) -> None:
    replay.compare_with_the_beginning()
    asked = set()
    for edge in EDGES[replay.name]:
        replay.do(c.PointAt(*edge), ticks=3)
        for seconds in replay.moments():
            replay.do(c.Seek(seconds), ticks=3)
            truly = replay.graph.edges.get(edge)
            both, ps = stated_beliefs(replay, edge), stated_ps(replay, edge)
            asked |= set(both) | set(ps)
            if truly is not None:
                belief = truly.belief
                assert set(both.values()) == {(f"{belief.p:.2f}", f"{belief.mu:.2f}")}, (edge, seconds, both)
                assert set(ps.values()) == {f"{belief.p:.2f}"}, (edge, seconds, ps)
                assert {"edge", "edges of the node", "title of the reasons", "scene"} <= {*both, *ps}
            elif edge_story(replay.timeline, *edge, replay.instant).life:
                assert set(both) <= {"edge"}  # It says what was believed last.
                assert ps.pop(QuestionName.COMPARE, "–") == "–"
                assert set(ps) <= {"curve"}
                assert "It was removed" in replay.text(QuestionName.EDGE)
                assert "Why is it gone?" in replay.text(QuestionName.EDGE)
            else:
                assert not both
                assert not ps
    assert {"edge", "reasons"} <= asked
    assert replay.name != DEMO_FAULT.name or {QuestionName.COMPARE, QuestionName.TRUTH, "curve"} <= asked


def test_all_answers_count_the_same_at_every_moment(replay: ReplayedFile) -> None:
    replay.compare_with_the_beginning()
    for seconds in replay.moments():
        replay.do(c.Seek(seconds), ticks=3)
        progress = replay.now.moment.progress
        events = [stamped.event for stamped in replay.timeline.events[: replay.known]]
        collisions = _count(events, e.Collided)
        marks = {row[0].strip(): row[1] for row in replay.rows(QuestionName.TIME)}
        assert progress.collisions == collisions == int(marks["collision"])
        assert progress.queries == _count(events, e.QueryStarted) == int(marks["query"])
        assert int(marks["failed leg"]) == sum(
            isinstance(each, e.AttemptEnded) and not each.succeeded for each in events
        )
        _check_map_size(replay)
        _check_results(replay)
        if replay.offers(QuestionName.TRUTH):
            _check_truth(replay, events)
        if replay.timeline.queries:
            compared = _compared(replay)
            assert compared["collisions"][0] == str(collisions)
            assert compared["arrived, of queries"][0] == f"{progress.reached} of {_count(events, e.QueryEnded)}"


def _compared(replay: ReplayedFile) -> dict[str, list[str]]:
    """Return the figures here and before the first query, by what they count."""
    figures = {row[0]: row[1:] for row in replay.tables(QuestionName.COMPARE)[0][1]}
    if not any(query.first < replay.known for query in replay.timeline.queries):
        assert all(here == there for here, there in figures.values()), figures
    return figures


def _check_map_size(replay: ReplayedFile) -> None:
    graph = replay.graph
    drawn = replay.now.moment.graph

    assert (len(drawn.ids), len(drawn.edges)) == (len(graph.nodes), len(graph.edges))
    if replay.timeline.queries:
        compared = _compared(replay)
        here = [compared[name][0].replace(",", "") for name in ("nodes", "edges")]
        assert here == [str(len(graph.nodes)), str(len(graph.edges))]


def _check_results(replay: ReplayedFile) -> None:
    """Compare what failed with the ends of the queries up to now."""
    if not replay.offers(QuestionName.FAILURES):
        assert not replay.timeline.queries
        return
    over = [query for query in replay.timeline.queries if query.end is not None and query.last < replay.known]
    failed = [query.id for query in over if query.succeeded is False]
    listed = [row for head, rows in replay.tables(QuestionName.FAILURES) if head[0] == "when" for row in rows]
    queries = "query" if len(over) == 1 else "queries"
    counted = f"{len(failed)} of {len(over)} {queries} failed" if over else "No query has ended yet."

    assert counted in replay.text(QuestionName.FAILURES)
    assert [int(row[1]) for row in listed] == failed
    share = re.search(r"Success over the last queries, now (\d+) %", replay.text(QuestionName.FAILURES))
    assert share is None or int(share[1]) == round(100 * (1 - len(failed) / len(over)))


def _check_truth(replay: ReplayedFile, events: list[e.Event]) -> None:
    """Compare the counts of “What is true?” with the map and the attempts up to now."""
    charts = [block for block in replay.answer(QuestionName.TRUTH).blocks if isinstance(block, CalibrationChart)]
    found = re.search(r"Before the (one|\d+) attempts?", replay.text(QuestionName.TRUTH))
    attempts = 0 if found is None else 1 if found[1] == "one" else int(found[1])

    assert sum(count for chart in charts for _, _, count in chart.cells) == len(replay.graph.edges)
    assert attempts == sum(isinstance(each, e.AttemptEnded) and each.source is not None for each in events)


def test_no_answer_states_what_happens_later_but_in_the_line_set_apart_for_it(replay: ReplayedFile) -> None:
    replay.compare_with_the_beginning()
    for seconds in replay.moments(4):
        replay.do(c.Seek(seconds), ticks=3)
        events = [stamped.event for stamped in replay.timeline.events[: replay.known]]
        begun = {each.query for each in events if isinstance(each, e.QueryStarted)}
        tried = {each.attempt for each in events if isinstance(each, e.AttemptStarted)}
        for question in (name for name in QuestionName if replay.offers(name)):
            for edge in EDGES[replay.name]:
                replay.do(c.PointAt(*edge), ticks=3)
                told = _told_of_now(replay.answer(question))
                text = answer_text(told)
                about = (question, seconds, text)
                assert all(at_s <= replay.now_s + _ROUNDING_S for at_s in _times(told)), about
                assert {int(each) for each in re.findall(r"[Qq]uery (\d+)", text)} <= begun, about
                assert {int(each) for each in re.findall(r"[Aa]ttempt (\d+)", text)} <= tried, about


def _told_of_now(answer: Answer) -> Answer:
    """Return an answer without what is set apart: lines and tables that begin with later, columns that count all."""
    kept = []
    for block in answer.blocks:
        if isinstance(block, Paragraph) and line_text(block.parts).startswith("Later"):
            continue
        if isinstance(block, Table) and block.head[0] == "later":
            continue
        if isinstance(block, Table) and "of all" in block.head:
            block = Table(block.head[:2], tuple(row[:2] for row in block.rows))
        kept.append(block)
    return Answer(tuple(kept))


def _times(answer: Answer) -> Iterator[float]:
    """Yield all times of the run, seconds, that an answer names, draws or leads to."""
    yield from (link.to.time_s for link in answer.links() if isinstance(link.to, c.Seek))
    yield from (float(each) for each in re.findall(r"(?<![\d.])(\d+\.\d) s\b", answer_text(answer)))
    for block in answer.blocks:
        if isinstance(block, StepChart) and block.x.label.startswith("time"):
            yield from (at_s for at_s, _ in block.points)


HOUR = 3600.0


def open_harness(folder: Path) -> SessionHarness:
    """Return a session with a live map whose plans look at presence; it is 8 o'clock."""
    harness = SessionHarness(folder)
    live_map = harness.state.live_map
    live_map.use_system(with_maintenance(live_map.system, "persistent"))
    pass_time(harness, 8 * HOUR)
    return harness


def pass_time(harness: SessionHarness, until_s: float) -> None:
    """Let the clock of the world jump."""
    harness.state.live.emit(e.WorldChanged(TimePassed(0.0), at_s=until_s))


def see(harness: SessionHarness, edge: tuple[int, int], at_s: float, *, present: bool) -> None:
    """Let the live map learn that an edge is open or blocked."""
    pass_time(harness, at_s)
    seen = PresenceObserved(*edge, present=present, stamp=at_s, cause=Cause.SIGHT)
    for delta in harness.state.live_map.change([seen]):
        harness.state.live.emit(e.GraphChanged(delta, query=0))


def test_what_was_seen_and_tried_is_told_as_of_the_moment(tmp_path: Path) -> None:
    harness = open_harness(tmp_path)
    nodes = sorted(harness.state.live_map.graph.nodes)
    harness.do(c.Ask(c.Action.GOAL, nodes[-1]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    plan = max((each.planned.nodes for each in harness.state.live.timeline.plans), key=len)
    harness.do(c.Ask(c.Action.GOAL, plan[0]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    edge = plan[0], plan[1]
    for at_s, present in ((9 * HOUR, False), (9.1 * HOUR, True), (9.2 * HOUR, False)):
        see(harness, edge, at_s, present=present)
        harness.wait(5)
    harness.do(c.Ask(c.Action.GOAL, nodes[-1]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    harness.do(c.PointAt(*edge))
    run, seen = harness.state.live.timeline, set()
    for stamp in sorted({run.instant(number).stamp for number in range(len(run.events))})[::3]:
        shown = harness.do(c.Seek(stamp - run.start_s), c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=4)
        before = run.events[: run.count_until(run.instant_at(shown.moment.stamp))]
        looks = sum(isinstance(_delta(each.event), PresenceObserved) for each in before)
        begun = {each.event.query for each in before if isinstance(each.event, e.QueryStarted)}
        told = answer_of(shown).blocks
        assert sum(len(block.looks) for block in told if isinstance(block, PresenceChart)) == looks
        progress = shown.moment.progress
        last = [look for each in before if isinstance(look := _delta(each.event), PresenceObserved)]
        assert progress.blocked == ({edge} if last and not last[-1].present else set())
        assert progress.seen_blocked == sum(not each.present for each in last)
        named = {int(number) for number in re.findall(r"Why did the robot .*? Query (\d+)", words(shown))}
        assert named <= begun
        assert not named or looks
        seen.add((looks, bool(named)))
    assert {0, 3} <= {looks for looks, _ in seen}
    assert {False, True} == {named for _, named in seen}


def test_why_it_went_around_is_told_for_a_plan_over_an_edge_that_was_seen_blocked(tmp_path: Path) -> None:
    harness = open_harness(tmp_path)
    graph = harness.state.live_map.graph
    goal = max(graph.nodes)
    harness.do(c.Ask(c.Action.GOAL, goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    plan = max((each.planned.nodes for each in harness.state.live.timeline.plans), key=len)
    harness.do(c.Ask(c.Action.GOAL, plan[0]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    see(harness, (plan[0], plan[1]), 9 * HOUR, present=False)
    see(harness, (plan[-2], plan[-1]), 9 * HOUR, present=False)
    harness.do(c.Ask(c.Action.GOAL, goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=3)
    assert "was open with p = 0." in words(shown)
    assert "Why did the robot" in words(shown)
    assert palette.EDGE_REMOVED in {stroke.colour for stroke in shown.inspection.answer.overlay.strokes}


def test_what_changed_since_the_first_query_names_doors_and_edges(tmp_path: Path) -> None:
    harness = open_harness(tmp_path)
    source, target = harness.an_edge
    harness.wait(3)
    harness.state.live.emit(e.QueryStarted(0, target))
    harness.state.live.emit(e.WorldChanged(DoorMoved(2, is_open=False), at_s=10 * HOUR))
    see(harness, (source, target), 10 * HOUR + 60, present=False)
    listed = harness.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE), ticks=15)
    shown = follow(harness, listed, BEFORE_FIRST_QUERY, ticks=4)
    html = words(shown)
    assert "closed here, not there: 1" in html
    assert f"{source} → {target}" in html
    assert "In the world: door 2 closed." in html


def _delta(event: e.Event) -> GraphDelta | None:
    return event.delta if isinstance(event, e.GraphChanged) else None


def _count(events: list[e.Event], kind: type) -> int:
    return sum(isinstance(each, kind) for each in events)
