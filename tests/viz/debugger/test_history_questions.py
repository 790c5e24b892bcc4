"""Questions about the past: why it is so, what happened when, what failed; and the keys that go from event to event."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core import palette
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph import deltas as d
from ltvn_core.navigation import events as e
from ltvn_core.types import CONTROL_STEP_S
from ltvn_viz.session.activities.playback import Playback, open_replay
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.seeking import seek_mark
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action
from tests.repository import RECORDINGS
from tests.viz.debugger.answer_links import follow, words
from tests.viz.session_harness import SessionHarness, said


class Past(SessionHarness):
    """A session that remembers two queries: the first failed and cost an edge, the second arrived and found a node."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.wait()  # With its first image the run begins.
        self.pruned, self.kept = list(self.state.live_map.graph.edges)[:2]
        self._first()
        self._second()

    def happens(self, *events: e.Event) -> float:
        """Let events happen, one each step; return when the last did, seconds."""
        for event in events:
            self.robot.advance()
            self.state.live.timeline.append_event(e.StampedEvent(self.robot.step, self.robot.stamp, event))
        return self.robot.stamp

    def _first(self) -> None:
        source, target = self.pruned
        self.begins_s = self.happens(e.QueryStarted(1, target))
        self.happens(e.Localised(1, source, source, 0.3, 0.9, None, 0.2, "global"))
        self.happens(e.Planned(1, self.pruned, 1.0))
        for _ in range(30):
            self.happens(e.StateChanged(e.NavigatorState.DRIVING))
        self.happens(e.AttemptStarted(1, 1, source, target, source, d.PoseRow(1.0, 0.0, 0.0), 0.9))
        ended = e.AttemptEnded(
            1, 1, source, target, source, e.AttemptEnd.TIMEOUT, 2.0, 0.1, succeeded=False, reason="too <far>"
        )
        self.wrong_s = self.happens(ended)
        belief = d.Belief(0.1, 1.0, 0.02)
        self.happens(e.GraphChanged(d.BeliefUpdated(*self.pruned, belief, 1, 0, d.Cause.ATTEMPT), 1, 1))
        self.pruned_s = self.happens(e.GraphChanged(d.EdgePruned(*self.pruned, d.Cause.ATTEMPT), 1, 1))
        self.happens(e.QueryEnded(1, target, e.Outcome.STEP_LIMIT, 40, 0, 1.0))

    def _second(self) -> None:
        self.second_s = self.happens(e.QueryStarted(2, self.kept[1]))
        self.happens(e.Planned(2, self.kept, 1.0))
        self.state.live.timeline.place_frame(90_000, np.array([2.0, 1.0, 0.0]))
        self.happens(e.GraphChanged(d.NodeAdded(d.Node(90_000, d.PoseRow(1.0, 1.0, 0.0)), d.Cause.EXPAND), 2))
        self.happens(e.QueryEnded(2, self.kept[1], e.Outcome.ARRIVED, 10, 0, 1.0))

    def seconds(self, stamp: float) -> float:
        return stamp - self.state.live.timeline.start_s


@pytest.fixture
def past(tmp_path: Path) -> Past:
    """A live run with a past."""
    return Past(tmp_path)


def test_history_counts_marks_and_leads_to_the_one_before_and_back(past: Past) -> None:
    counted = past.do(c.Ask(c.Action.QUESTION, QuestionName.TIME))
    assert counted.inspection.answer.overlay.nodes == {90_000: palette.EDGE_ADDED}
    assert len(counted.inspection.answer.overlay.strokes) == 1
    seek_mark(past.state, MarkKind.PRUNE, forwards=False)
    before = past.wait()
    assert before.moment.stamp == pytest.approx(past.pruned_s, abs=1e-3)
    assert before.inspection.answer.overlay.nodes == {}
    assert len(before.inspection.answer.overlay.strokes) == 1


def test_keys_go_from_query_to_query_and_from_event_to_event_and_back_to_now(past: Past) -> None:
    def press(action: Action) -> Snapshot:
        return past.do(c.Ask(action))

    assert press(Action.QUERY_BEFORE).moment.stamp == pytest.approx(past.second_s, abs=1e-3)
    assert press(Action.QUERY_BEFORE).moment.stamp == pytest.approx(past.begins_s, abs=1e-3)
    assert press(Action.EVENT_AFTER).moment.stamp == pytest.approx(past.begins_s + CONTROL_STEP_S, abs=1e-3)
    assert press(Action.EVENT_BEFORE).moment.stamp == pytest.approx(past.begins_s, abs=1e-3)
    assert press(Action.QUERY_AFTER).moment.stamp == pytest.approx(past.second_s, abs=1e-3)
    press(Action.QUERY_AFTER)
    assert past.state.shown_stamp is None


def test_where_there_is_nothing_before_the_page_says_so(past: Past) -> None:
    past.do(c.Ask(c.Action.QUERY_BEFORE), c.Ask(c.Action.QUERY_BEFORE))
    shown = past.do(c.Ask(c.Action.QUERY_BEFORE))
    assert "no query before" in said(shown)


def test_a_failed_query_leads_to_the_second_before_it_went_wrong(past: Past) -> None:
    listed = past.do(c.Ask(c.Action.QUESTION, QuestionName.FAILURES), ticks=2)
    assert "1 of 2 queries failed" in words(listed)
    assert "Later" not in words(listed)
    assert len(listed.inspection.answer.overlay.strokes) == 1
    assert follow(past, past.now, f"edge {past.pruned[0]}").inspection.selection.edge == past.pruned
    there = follow(past, past.now, f"{past.seconds(past.wrong_s) - 1.0:.1f} s")
    assert there.moment.stamp == pytest.approx(past.wrong_s - 1.0, abs=0.11)


def test_failures_can_be_narrowed_down_to_one_cause(past: Past) -> None:
    past.do(c.Ask(c.Action.QUESTION, QuestionName.FAILURES), ticks=2)
    follow(past, past.now, "1")
    assert "show all" in words(past.now)
    assert "show all" not in words(follow(past, past.now, "show all"))
    assert past.do(c.Ask(c.Action.TELL, "bad luck")).message is not None


def test_a_dip_of_success_leads_to_its_queries_and_to_the_edges_it_touched(past: Past) -> None:
    goal = past.kept[1]
    for query in range(3, 27):
        past.happens(e.QueryStarted(query, goal))
        if query == 16:
            past.happens(e.GraphChanged(d.EdgePruned(*past.kept, d.Cause.ATTEMPT), query))
        past.happens(e.QueryEnded(query, goal, e.Outcome.ARRIVED if query < 15 else e.Outcome.LOST, 10, 0, 1.0))
    told = words(past.do(c.Ask(c.Action.QUESTION, QuestionName.FAILURES), ticks=2))
    assert "Dip: success fell by 100 % from query 14 to query 24" in told
    assert "1 edges were removed" in told
    assert f"{past.kept[0]} → {past.kept[1]} pruned" in told


@pytest.fixture(scope="module")
def faulty() -> Playback:
    """The recording with planted faults: a wall that the map ignores, a look-alike pair, a missing edge."""
    return open_replay(RecordingLibrary(RECORDINGS), "demo-fault.rrd")


def test_every_kind_of_mark_is_reached_forwards_and_backwards(past: Past, faulty: Playback) -> None:
    past.state.open_replay = lambda _: faulty
    past.do(c.OpenRecording("demo-fault.rrd"), ticks=2)
    index = past.state.shown_run

    def go(kind: MarkKind, *, forwards: bool) -> float:
        seek_mark(past.state, kind, forwards=forwards)
        return past.wait().moment.stamp

    for kind in {mark.kind for mark in index.marks} - {MarkKind.MAP}:
        stamps = sorted({mark.instant.stamp for mark in index.marks_until(None, kind)})
        begin = past.do(c.Seek(0.0)).moment.stamp
        ahead = [stamp for stamp in stamps if stamp > begin]
        there = [go(kind, forwards=True) for _ in ahead]
        back = [go(kind, forwards=False) for _ in stamps[1:]]
        assert there == pytest.approx(ahead, abs=1e-3)
        assert back == pytest.approx(stamps[-2::-1], abs=1e-3)
