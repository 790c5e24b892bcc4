"""Whatever is asked about an edge, all answers are about the moment of the cursor, and agree."""

import html
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.analysis.edge_history import edge_history
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.graph.deltas import GraphDelta, PresenceObserved
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Collided, Event, GraphChanged, QueryStarted
from ltvn_viz.app_setup import open_app_state
from ltvn_viz.debugger.compared_map import BEFORE_FIRST_QUERY
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session import commands as c
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from tests.repository import RECORDINGS
from tests.viz.debugger.answer_links import links
from tests.viz.debugger.seen_edges import HOUR, open_harness, see
from tests.viz.session_harness import FakeDriver

PRUNED, TRUSTED = (1489, 2621), (3081, 2226)
"""An edge that failed and was pruned, and one that was driven and believed more each time."""
MOMENTS = 20


class Replay:
    """The recording with faults, open in a session."""

    def __init__(self, stack: ExitStack) -> None:
        options = AppOptions(recordings=RECORDINGS, replay="demo-fault.rrd")
        self.state = open_app_state(options, stack, ThumbnailStore())
        self.shown: list[Snapshot] = []
        self.session = Session(self.state, FakeDriver(), self.shown.append)
        stack.callback(self.session.close)
        self.do(c.OpenRecording("demo-fault.rrd"))
        self.do()

    def do(self, *commands: c.Command, ticks: int = 3) -> Snapshot:
        for command in commands:
            self.session.send(command)
        for _ in range(ticks):
            self.session.tick()
            self.state.worker.settle()
        return self.shown[-1]

    def rows(self, question: str) -> list[list[str]]:
        """The table cells of an answer."""
        answer = self.do(c.ChooseQuestion(question)).inspection.html
        rows = re.findall(r"<tr>(.*?)</tr>", answer)
        return [[plain(cell) for cell in re.findall(r"<td>(.*?)</td>", row)] for row in rows if "<td>" in row]

    def text(self, question: str) -> str:
        return plain(self.do(c.ChooseQuestion(question)).inspection.html)

    @property
    def timeline(self) -> Timeline:
        return self.state.shown_run


def plain(markup: str) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", markup.replace("</div>", "\n")))


@pytest.fixture(scope="module")
def replay() -> Iterator[Replay]:
    with ExitStack() as stack:
        yield Replay(stack)


def moments(replay: Replay) -> list[float]:
    """Twenty moments of the recording, seconds, the very first and last among them."""
    return np.linspace(0.0, replay.timeline.end_s - replay.timeline.start_s, MOMENTS).tolist()


def compare_with_the_beginning(replay: Replay) -> None:
    offered = replay.do(c.ChooseQuestion(QuestionName.COMPARE))
    found = [number for number, label in links(offered) if label == BEFORE_FIRST_QUERY]
    if found:
        replay.do(c.FollowLink(found[0]))


def stated_beliefs(replay: Replay, edge: EdgeKey) -> dict[str, str]:
    """What each answer that names the edge's p says of it, by the question."""
    name, stated = f"{edge[0]} → {edge[1]}", {}
    if found := re.search(r"p (\d\.\d\d) · length", replay.text(QuestionName.EDGE)):
        stated[QuestionName.EDGE] = found[1]
    if found := re.search(r"Why is (?:it so weak, )?p = (\d\.\d\d)\?", replay.text(QuestionName.BLAME)):
        stated[QuestionName.BLAME] = found[1]
    for question in (QuestionName.COMPARE, QuestionName.TRUTH):
        if found := next((row for row in replay.rows(question) if row[:1] == [name]), None):
            stated[question] = found[1].split()[0]
    replay.do(c.PointAt(edge[0]))
    if found := next((row for row in replay.rows(QuestionName.EDGE) if row[:1] == [name]), None):
        stated["edges of the node"] = found[1]
    replay.do(c.PointAt(*edge))
    graph = replay.shown[-1].moment.graph
    drawn = {(int(graph.ids[a]), int(graph.ids[b])): p for (a, b), p in zip(graph.edges, graph.p, strict=True)}
    if edge in drawn:
        stated["scene"] = f"{drawn[edge]:.2f}"
    return stated


@pytest.mark.parametrize("edge", [PRUNED, TRUSTED])
def test_all_answers_about_an_edge_name_the_same_p_at_every_moment(replay: Replay, edge: EdgeKey) -> None:
    compare_with_the_beginning(replay)
    replay.do(c.PointAt(*edge))
    seen, asked = set(), set()
    for seconds in moments(replay):
        shown = replay.do(c.Seek(seconds))
        truly = replay.timeline.graph_at(replay.timeline.instant_at(shown.moment.stamp)).edges.get(edge)
        stated = stated_beliefs(replay, edge)

        if truly is None:
            assert stated.pop(QuestionName.COMPARE) == "–", seconds
            assert set(stated) <= {QuestionName.EDGE}  # It says what was believed last.
            assert "It left the map" in replay.text(QuestionName.EDGE)
            assert "Why is it gone?" in replay.text(QuestionName.BLAME)
        else:
            assert set(stated.values()) == {f"{truly.belief.p:.2f}"}, (seconds, stated)
            assert {QuestionName.EDGE, QuestionName.BLAME, "edges of the node", "scene"} <= set(stated)
        seen |= set(stated.values())
        asked |= set(stated)
    assert len(seen) > 1  # It did change on the way.
    assert {QuestionName.COMPARE, QuestionName.TRUTH} <= asked


@pytest.mark.parametrize("edge", [PRUNED, TRUSTED])
def test_all_answers_about_an_edge_know_the_same_attempts_with_the_same_d_and_r(replay: Replay, edge: EdgeKey) -> None:
    replay.do(c.PointAt(*edge))
    counts = set()
    for seconds in moments(replay):
        shown = replay.do(c.Seek(seconds))
        at = replay.timeline.instant_at(shown.moment.stamp)
        history = edge_history(replay.timeline, *edge, at)
        rows = [row[3:] for row in replay.rows(QuestionName.EDGE)]
        told = re.findall(
            r"Attempt \d+ in query \d+ .*?d = (\d\.\d\d).*?r = (\d\.\d\d)", replay.text(QuestionName.BLAME)
        )

        ended = [each for each in history.attempts if each.ended is not None]
        assert all(each.ended is not None and each.ended.step <= at.step for each in ended)
        assert rows == [[_number(each.distance), _number(each.reachability)] for each in history.attempts]
        assert all([d, r] in rows for d, r in told)
        counts.add(len(rows))
    assert len(counts) > 1


def test_all_answers_count_the_same_collisions_and_failures_at_every_moment(replay: Replay) -> None:
    for seconds in moments(replay):
        shown = replay.do(c.Seek(seconds))
        before = replay.timeline.count_until(replay.timeline.instant_at(shown.moment.stamp))
        truly = sum(isinstance(stamped.event, Collided) for stamped in replay.timeline.events[:before])
        listed = {row[0].removeprefix("■ "): row[1] for row in replay.rows(QuestionName.TIME)}
        over = sum(query.end is not None and query.last < before for query in replay.timeline.queries)

        assert shown.moment.progress.collisions == truly == int(listed["collision"])
        counted = f"of {over} queries failed" if over else "No query is over yet."
        assert counted in replay.text(QuestionName.FAILURES)


def test_what_if_begins_with_the_map_and_the_goal_of_the_moment(replay: Replay) -> None:
    replay.do(c.PointAt(*PRUNED), c.ChooseQuestion(QuestionName.WHAT_IF), c.SubmitText("belief weight = 2"))
    name, goals = "{}->{}".format(*PRUNED), set()
    for seconds in moments(replay):
        shown = replay.do(c.Seek(seconds))
        count = replay.timeline.count_until(replay.timeline.instant_at(shown.moment.stamp))
        told = replay.text(QuestionName.WHAT_IF)
        is_there = PRUNED in replay.timeline.graph_at(replay.timeline.instant_at(shown.moment.stamp)).edges

        assert (f"What if: without {name}" in told, f"What if: with {name}" in told) == (is_there, not is_there)
        if (under_way := replay.timeline.query_at(count - 1)) is not None:
            found = re.search(r"From \d+ to (\d+):", told)
            assert found is None or int(found[1]) == under_way.goal, (seconds, told)
            goals |= set() if found is None else {found[1]}
    replay.do(c.SubmitText("forget all"))
    assert len(goals) > 1


def test_what_was_seen_and_tried_is_told_as_of_the_moment(tmp_path: Path) -> None:
    harness = open_harness(tmp_path)
    nodes = sorted(harness.state.live_map.graph.nodes)
    harness.do(c.NavigateTo(nodes[-1]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    plan = max((each.planned.nodes for each in harness.state.live.timeline.plans), key=len)
    harness.do(c.NavigateTo(plan[0]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    edge = plan[0], plan[1]
    for at_s, present in ((9 * HOUR, False), (9.1 * HOUR, True), (9.2 * HOUR, False)):
        see(harness, edge, at_s, present=present)
        harness.wait(5)
    harness.do(c.NavigateTo(nodes[-1]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    harness.do(c.PointAt(*edge))
    run, seen = harness.state.live.timeline, set()
    for stamp in sorted({run.instant(number).stamp for number in range(len(run.events))})[::3]:
        shown = harness.do(c.Seek(stamp - run.start_s), c.ChooseQuestion(QuestionName.PRESENCE), ticks=2)
        before = run.events[: run.count_until(run.instant_at(shown.moment.stamp))]
        looks = sum(isinstance(_delta(each.event), PresenceObserved) for each in before)
        begun = {each.event.query for each in before if isinstance(each.event, QueryStarted)}

        told = shown.inspection.html
        assert told.count("<title>seen ") == looks
        assert ("No edge was seen blocked up to now." in told) == (looks == 0)
        tried = harness.do(c.ChooseQuestion(QuestionName.TRIED), ticks=2).inspection.html
        named = {int(number) for number in re.findall(r"Query (\d+)", tried)}
        assert named <= begun
        assert not named or looks
        seen.add((looks, bool(named)))
    assert {0, 3} <= {looks for looks, _ in seen}
    assert {False, True} == {named for _, named in seen}


def test_no_answer_says_a_word_about_the_end_of_the_run_at_its_beginning(replay: Replay) -> None:
    replay.do(c.Seek(0.0), c.PointAt(*PRUNED))

    told = replay.text(QuestionName.EDGE)

    assert "under way" in told
    assert "failed" not in told
    assert "Later it leaves the map" in told
    assert "It left the map" not in told


def _delta(event: Event) -> GraphDelta | None:
    return event.delta if isinstance(event, GraphChanged) else None


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
