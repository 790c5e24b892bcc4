"""The size that is promised: 10,000 nodes, 50,000 edges, 40,000 events of driving. It tests counts, not times."""

import itertools
from collections.abc import Iterator

import pytest

from ltvn_core.analysis.edge_explanation import explain_edge
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.failure_triage import failed_queries
from ltvn_core.analysis.lifelong_success import lifelong_success
from ltvn_core.analysis.plan_explanation import explain_planned_edge
from ltvn_core.analysis.replanning import Rules
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.config import PAPER
from ltvn_core.navigation.events import Outcome, Planned, QueryStarted, StampedEvent
from tests.core.analysis import example_runs as runs

NODES, SPAN, LEGS, QUERIES = 10_000, 5, 80, 100


@pytest.fixture(scope="module")
def events() -> list[StampedEvent]:
    """A long corridor that is driven up and down its first nodes, with a failure at the end of every tenth query."""
    nodes = runs.at(0, *(runs.node(frame, float(frame)) for frame in range(NODES)))
    pairs = [(node, node + ahead) for node in range(NODES) for ahead in range(1, SPAN + 1) if node + ahead < NODES]
    edges = runs.at(0, *(runs.edge(source, target, mu=target - source) for source, target in pairs))
    return [*nodes, *edges, *itertools.chain.from_iterable(map(_query, range(QUERIES)))]


def _query(number: int) -> list[StampedEvent]:
    step, run = 1 + number * 1000, list[StampedEvent]()
    run += runs.at(step, QueryStarted(number, LEGS))
    failing = number % 10 == 9
    for node in range(LEGS):
        attempt, step = number * LEGS + node, step + 10
        plan = Planned(number, tuple(range(node, LEGS + 1)), float(LEGS - node))
        drive = runs.attempt_started(number, attempt, node, node + 1, step)
        wrong = failing and node == LEGS - 1
        done = runs.failed(drive, step + 9) if wrong else runs.arrived(drive, step + 9)
        counts = (number + 1, number + 1 - number // 10)
        lesson = runs.belief(node, node + 1, 0.9, counts, (number, attempt))
        run += [*runs.at(step, runs.localised(number, step, node), plan, drive), *runs.at(step + 9, done, lesson)]
    outcome = Outcome.STEP_LIMIT if failing else Outcome.ARRIVED
    return [*run, *runs.at(step + 10, runs.ended(number, LEGS, outcome))]


def test_a_long_life_on_a_large_map_is_told_completely(events: list[StampedEvent]) -> None:
    timeline = Timeline.of(events)
    assert len(events) > 50_000 + 40_000
    assert (len(timeline.queries), len(timeline.attempts)) == (QUERIES, QUERIES * LEGS)
    assert sum(mark.kind is MarkKind.FAILURE for mark in timeline.marks) == QUERIES // 10
    assert len(timeline.graph_at().edges) == 49_985
    story = edge_story(timeline, LEGS - 1, LEGS)
    assert (len(story.attempts), len(story.planned_at)) == (QUERIES, QUERIES * LEGS)
    assert len(explain_edge(timeline, LEGS - 1, LEGS)) == 2
    assert len(explain_planned_edge(timeline, 0, 1, Rules(PAPER))) == 3
    assert len(failed_queries(timeline)) == QUERIES // 10
    assert lifelong_success(timeline).edges.tolist() == [49_985] * QUERIES


def test_each_event_is_looked_at_once(events: list[StampedEvent]) -> None:
    looked = 0

    def counting() -> Iterator[StampedEvent]:
        nonlocal looked
        for stamped in events:
            looked += 1
            yield stamped

    assert len(Timeline.of(counting()).events) == looked == len(events)
