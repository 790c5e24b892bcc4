"""A recording or a live run stops where a person wanted it to."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.analysis.breakpoints import (
    BREAKPOINT_EXAMPLES,
    BeliefCrossingBreakpoint,
    BreakpointTrigger,
    breakpoint_hit,
    find_breakpoint_hits,
    format_breakpoint,
    parse_breakpoint,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.config import BeliefConfig
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.graph.deltas import (
    Belief,
    BeliefUpdated,
    Cause,
    Edge,
    EdgeAdded,
    EdgePruned,
    Node,
    NodeAdded,
    NodeDropped,
    NodeNamed,
    PoseRow,
)
from ltvn_core.navigation import events as e
from tests.repository import DEMO_DRIVE

HERE = PoseRow(0.0, 0.0, 0.0)


def look(node: int | None, margin: float, distance: float = 0.3) -> e.Localised:
    return e.Localised(0, 1, node, distance, 0.9, 7, margin, "global")


def believed(p: float, cause: Cause = Cause.ATTEMPT) -> e.GraphChanged:
    return e.GraphChanged(BeliefUpdated(1, 2, Belief(p, 1.0, 0.1), 1, 0, cause))


STORY: list[e.Event] = [
    e.GraphChanged(NodeAdded(Node(1, HERE), Cause.BUILD)),
    e.GraphChanged(NodeAdded(Node(2, HERE), Cause.BUILD)),
    e.GraphChanged(EdgeAdded(Edge(1, 2, HERE, Belief(0.8, 1.0, 0.1)), Cause.BUILD)),
    e.QueryStarted(0, 3),  # 3
    look(1, 0.6),
    e.Planned(0, (1, 2, 3), 2.0),  # 5
    e.AttemptStarted(0, 1, 1, 2, 4, HERE, 0.9),
    e.Collided(0, 1),  # 7
    e.AttemptEnded(0, 1, 1, 2, 5, e.AttemptEnd.COLLISION, 1.0, 0.2, succeeded=False, reason="not connectable"),
    believed(0.4),  # 9
    look(2, 0.1),
    e.Planned(0, (2, 3), 1.0),  # 11
    believed(0.3),
    e.Planned(0, (2, 9, 3), 3.0),  # 13
    believed(0.7),
    look(None, 0.0, 1.6),  # 15
    e.Planned(0, (), math.inf),
    e.GraphChanged(NodeAdded(Node(9, HERE), Cause.EXPAND)),  # 17
    e.GraphChanged(EdgePruned(1, 2, Cause.ATTEMPT)),
    e.GraphChanged(NodeNamed(9, "door", False, Cause.HAND)),  # 19
    e.GraphChanged(NodeDropped(2, Cause.HAND)),
    e.QueryStarted(1, 1),  # 21
    e.Planned(1, (4, 1), 1.0),
]
STAMPED = [e.StampedEvent(k, 0.1 * k, event) for k, event in enumerate(STORY)]


@pytest.mark.parametrize(
    ("text", "steps"),
    [
        ("prune", [18]),
        ("expand", [17]),
        ("collision", [7]),
        ("replan", [13, 16]),
        ("failed leg", [8]),
        ("lost", [15]),
        ("no path", [16]),
        ("by hand", [19, 20]),
        ("p crosses R_p", [9, 14]),
        ("p crosses 0.35", [12, 14]),
        ("margin < 0.2", [10]),
        ("margin>0.5", [4]),
        ("distance > 1", [15]),
        ("r < 0.5", []),
        ("edge 1->2", [6, 8, 9, 12, 14, 18]),
        ("Edge 1 → 2", [6, 8, 9, 12, 14, 18]),
        ("edge 2->1", []),
        ("edge 77->78", []),
        ("node 2", [6, 10, 20]),
        ("node 9", [17, 19]),
        ("node 1", [4, 21]),
        ("p(1->2) < 0.5", [9]),
        ("p( 1 -> 2 ) > 0.6", [14]),
        ("mu(1->2) > 0.5", []),
        ("p(1->3) < 0.5", []),
    ],
)
def test_a_breakpoint_stops_there_and_nowhere_else(text: str, steps: list[int]) -> None:
    hits = list(find_breakpoint_hits(Timeline.of(STAMPED), [parse_breakpoint(text)]))
    assert [hit.moment.step for hit in hits] == steps
    assert all(hit.why for hit in hits)


def test_several_breakpoints_at_one_moment_are_one_hit() -> None:
    asked = [parse_breakpoint(text) for text in ("edge 1->2", "prune", "p crosses 0.5")]
    hit = next(hit for hit in find_breakpoint_hits(Timeline.of(STAMPED), asked) if hit.moment.step == 9)
    assert hit.breakpoints == (asked[0], asked[2])
    assert (
        hit.why == "edge 1 → 2 has p 0.40, 0 of 1 attempt succeeded (attempt); p of edge 1 → 2 fell from 0.80 to 0.40"
    )


def test_live_watching_finds_what_replay_finds_and_may_be_changed_meanwhile() -> None:
    asked, live, timeline = [BeliefCrossingBreakpoint(0.5)], [], Timeline()
    for k, stamped in enumerate(STAMPED):
        timeline.append_event(stamped)
        if hit := breakpoint_hit(timeline, k, asked if k >= 6 else []):
            live.append(hit)
    assert live == list(find_breakpoint_hits(Timeline.of(STAMPED), asked))


def test_every_event_of_the_demo_can_be_watched() -> None:
    events = Recording.open(DEMO_DRIVE).events
    asked = [parse_breakpoint(text) for text in BREAKPOINT_EXAMPLES]
    hits = list(find_breakpoint_hits(Timeline.of(events), asked))
    looks = [s.event for s in events if isinstance(s.event, e.Localised)]
    small = sum(1 for hit in hits if parse_breakpoint("margin < 0.2") in hit.breakpoints)
    assert small == sum(1 for seen in looks if seen.node is not None and seen.margin < 0.2)
    failed = sum(1 for s in events if isinstance(s.event, e.AttemptEnded) and not s.event.succeeded)
    assert sum(1 for hit in hits if parse_breakpoint("failed leg") in hit.breakpoints) == failed


def test_a_recording_that_begins_in_the_middle_of_a_query_is_watched_as_far_as_it_tells() -> None:
    asked = [parse_breakpoint(text) for text in ("p crosses 0.5", "p(1->2) < 0.5", "replan", "prune")]
    assert [hit.moment.step for hit in find_breakpoint_hits(Timeline.of(STAMPED[9:]), asked)] == [9, 13, 14, 16, 18]


def test_fifty_thousand_events_hit_as_often_as_they_should() -> None:
    events = (e.StampedEvent(k, 0.1 * k, believed(0.4 if k % 2 else 0.6)) for k in range(50_000))
    assert sum(1 for _ in find_breakpoint_hits(Timeline.of(events), [BeliefCrossingBreakpoint(0.5)])) == 49_999


@given(st.sampled_from(BREAKPOINT_EXAMPLES), st.floats(allow_nan=False, allow_infinity=False))
def test_what_is_shown_can_be_typed(example: str, value: float) -> None:
    typed = parse_breakpoint(example.replace("0.5", repr(value)))
    assert parse_breakpoint(format_breakpoint(typed)) == typed


def test_the_prune_threshold_is_shown_by_the_name_it_was_asked_for_by() -> None:
    typed = parse_breakpoint("p crosses R_p", BeliefConfig(prune_below=0.4))

    assert typed == BeliefCrossingBreakpoint(0.4, is_prune_threshold=True)
    assert format_breakpoint(typed) == "p crosses R_p"


@pytest.mark.parametrize(
    "text", ["", "prunes", "edge 12", "edge a->b", "margin = 3", "margin < ", "p(12->40)", "p < 0.5", "node -1"]
)
def test_a_mistyped_breakpoint_is_answered_with_what_is_valid(text: str) -> None:
    with pytest.raises(OptionError, match=r"breakpoint.*: prune, expand.*edge 12->40"):
        parse_breakpoint(text)


@pytest.mark.parametrize("word", ["much", "nan", "inf"])
def test_a_value_that_is_no_number_is_named(word: str) -> None:
    with pytest.raises(OptionError, match=f"'{word}' is not a number"):
        parse_breakpoint(f"margin < {word}")


def test_every_happening_has_an_example() -> None:
    assert set(BreakpointTrigger) <= set(BREAKPOINT_EXAMPLES)


def test_an_edge_that_leaves_with_its_node_is_noticed() -> None:
    dropped = e.StampedEvent(9, 0.9, e.GraphChanged(NodeDropped(2, Cause.HAND)))
    hits = list(find_breakpoint_hits(Timeline.of([*STAMPED[:3], dropped]), [parse_breakpoint("edge 1->2")]))
    assert [hit.why for hit in hits] == ["edge 1 → 2 left with node 2"]


def test_an_edge_that_had_left_already_does_not_leave_again_with_its_node() -> None:
    gone = [
        e.GraphChanged(EdgePruned(1, 2, Cause.ATTEMPT)),
        e.GraphChanged(NodeDropped(2, Cause.HAND)),
        e.GraphChanged(NodeDropped(1, Cause.HAND)),
    ]
    run = [*STAMPED[:3], *(e.StampedEvent(9 + k, 0.9, event) for k, event in enumerate(gone))]
    hits = list(find_breakpoint_hits(Timeline.of(run), [parse_breakpoint("edge 1->2")]))
    assert [hit.moment.step for hit in hits] == [9]


def test_an_edge_of_the_map_before_does_not_leave_with_a_node_of_this_one() -> None:
    second = [e.GraphChanged(NodeAdded(Node(1, HERE), Cause.LOAD)), e.GraphChanged(NodeDropped(1, Cause.HAND))]
    run = [*STAMPED[:3], *(e.StampedEvent(9 + k, 0.9, event) for k, event in enumerate(second))]
    assert list(find_breakpoint_hits(Timeline.of(run), [parse_breakpoint("edge 1->2")])) == []
