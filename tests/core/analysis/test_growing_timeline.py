"""A run that grows is the same as the recording of it, at every event, whatever comes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MarkKind
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, EdgePruned, NodeDropped
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation import events as e
from tests.core.analysis import example_runs as runs

NODES = st.integers(0, 5)
CAUSES = st.sampled_from([Cause.LOAD, Cause.BUILD, Cause.ONLINE, Cause.HAND])


@st.composite
def map_changes(draw: st.DrawFn) -> e.GraphChanged:
    """One change of a map; many of them do not fit, as in a recording that lost some."""
    first, second = draw(NODES), draw(NODES)
    match draw(st.sampled_from(["node", "edge", "edge", "belief", "prune", "drop"])):
        case "node":
            return runs.node(first, float(first), draw(CAUSES))
        case "edge":
            return runs.edge(first, second, cause=draw(CAUSES))
        case "belief":
            belief = Belief(draw(st.floats(0.0, 1.0)), 1.0, 0.1)
            return e.GraphChanged(BeliefUpdated(first, second, belief, attempts=1, successes=0, cause=Cause.ATTEMPT))
        case "prune":
            return e.GraphChanged(EdgePruned(first, second, Cause.ATTEMPT))
        case _:
            return e.GraphChanged(NodeDropped(first, Cause.HAND))


@st.composite
def navigation_events(draw: st.DrawFn) -> e.Event:
    """One event of navigation, whether or not it belongs to what came before."""
    query, source, target = draw(st.integers(0, 2)), draw(NODES), draw(NODES)
    started = runs.attempt_started(query, draw(st.integers(0, 3)), source, target, 0)
    return draw(
        st.sampled_from(
            [
                e.QueryStarted(query, target),
                runs.localised(query, 0, source),
                e.Planned(query, (source, target), 1.0),
                started,
                runs.arrived(started, 0),
                runs.failed(started, 0),
                runs.ended(query, target),
                e.Judged(query, reached=True, position_error_m=0.1, yaw_error_rad=0.0),
                e.Note("something to read"),
            ]
        )
    )


def stamped(events: list[e.Event], steps: list[int]) -> list[e.StampedEvent]:
    return [e.StampedEvent(step, 0.1 * step, event) for step, event in zip(steps, events, strict=False)]


EVENTS = st.lists(map_changes() | navigation_events(), max_size=40)
IN_ORDER = st.builds(stamped, EVENTS, st.lists(st.integers(0, 30), min_size=40, max_size=40).map(sorted))
IN_DISORDER = st.builds(stamped, EVENTS, st.lists(st.integers(0, 30), min_size=40, max_size=40))


def grown(run: list[e.StampedEvent]) -> Timeline:
    timeline = Timeline()
    for event in run:
        timeline.append_event(event)
    return timeline


def drawn(view: GraphArrays) -> tuple[list[int], dict[tuple[int, ...], float]]:
    edges = {tuple(view.ids[list(ends)].tolist()): p for ends, p in zip(view.edges, view.p.tolist(), strict=True)}
    return view.ids.tolist(), edges


def drawable(graph: TopologicalGraph) -> tuple[list[int], dict[tuple[int, ...], float]]:
    return list(graph.nodes), {key: edge.belief.p for key, edge in graph.edges.items()}


def everything(timeline: Timeline) -> list[object]:
    count = len(timeline.events)
    return [
        list(timeline.events),
        timeline.queries,
        timeline.attempts,
        list(timeline.plans),
        list(timeline.changes),
        list(timeline.marks),
        timeline.epochs,
        timeline.notes,
        [timeline.instant(event) for event in range(count)],
        [timeline.progress_before(event) for event in range(count + 1)],
        [drawable(timeline.graph_before(event)) for event in range(count + 1)],
        [timeline.changes_of_edge(source, target) for source in range(6) for target in range(6)],
        [timeline.attempts_of_edge(source, target) for source in range(6) for target in range(6)],
        [timeline.changes_of_node(node) for node in range(6)],
        [drawn(timeline.drawing.at(version)) for version in range(len(timeline.changes) + 1)],
    ]


@given(IN_ORDER | IN_DISORDER)
def test_a_run_that_grew_equals_the_recording_of_it(run: list[e.StampedEvent]) -> None:
    assert everything(grown(run)) == everything(Timeline.of(run))


@given(IN_ORDER, st.integers(0, 40))
def test_a_copy_stays_as_it_was_while_the_run_goes_on(run: list[e.StampedEvent], cut: int) -> None:
    timeline = grown(run[:cut])
    copy = timeline.copy()
    for event in run[cut:]:
        timeline.append_event(event)
    assert everything(copy)[:-1] == everything(Timeline.of(run[:cut]))[:-1]


@given(IN_ORDER | IN_DISORDER)
def test_what_is_drawn_is_the_map_at_every_event(run: list[e.StampedEvent]) -> None:
    timeline = Timeline.of(run)
    for event in range(len(run) + 1):
        version = timeline.change_count_before(event)
        assert drawn(timeline.drawing.at(version)) == drawable(timeline.graph_before(event))


@given(IN_DISORDER, st.lists(st.floats(-5.0, 5.0), min_size=40, max_size=40))
def test_time_never_runs_back(run: list[e.StampedEvent], jitter: list[float]) -> None:
    timeline = grown([event._replace(stamp=event.stamp + late) for event, late in zip(run, jitter, strict=False)])
    instants = [timeline.instant(event) for event in range(len(run))]
    assert [instant.stamp for instant in instants] == sorted(instant.stamp for instant in instants)
    assert [instant.step for instant in instants] == sorted(instant.step for instant in instants)


@given(st.lists(st.lists(st.integers(0, 9), min_size=1, unique=True), min_size=1, max_size=5))
@settings(max_examples=50)
def test_each_loaded_map_begins_an_epoch_with_nothing_left_of_the_one_before(maps: list[list[int]]) -> None:
    run = [
        event
        for step, nodes in enumerate(maps)
        for event in runs.at(
            step,
            *(runs.node(node, cause=Cause.LOAD) for node in nodes),
            # An edge ends the nodes of a file, so that the next node begins another map.
            *(runs.edge(nodes[0], node, cause=Cause.LOAD) for node in (*nodes[1:], 99)[:1]),
        )
    ]
    timeline = Timeline.of(run)
    assert len(timeline.epochs) == len(maps)
    assert [mark.kind for mark in timeline.marks] == [MarkKind.MAP] * len(maps)
    for step, nodes in enumerate(maps):
        assert list(timeline.graph_at(Instant(step, 0.0)).nodes) == nodes
        version = timeline.change_count_before(timeline.count_until(Instant(step, 0.0)))
        assert timeline.drawing.at(version).ids.tolist() == nodes


def test_after_a_second_map_comes_in_nothing_of_the_first_is_drawn_and_nothing_fades() -> None:
    second = [runs.node(0, cause=Cause.LOAD), runs.node(7, cause=Cause.LOAD), runs.edge(0, 7, cause=Cause.LOAD)]
    timeline = Timeline.of([*runs.two_failures(), *runs.at(200, *second)])
    version = len(timeline.changes)
    assert drawn(timeline.drawing.at(version)) == ([0, 7], {(0, 7): 0.9})
    assert not len(timeline.drawing.removed_edges(version, 20.0, 3.0).ages_s)


def test_a_node_is_drawn_where_its_image_was_taken() -> None:
    run = runs.at(1, runs.node(0, 5.0), runs.node(1, 6.0))
    timeline = Timeline.of(run, frames=[(0, 0.0, np.array([1.0, 2.0, 0.5]))])
    np.testing.assert_allclose(timeline.drawing.at(2).poses, [[1.0, 2.0, 0.5], [6.0, 0.0, 0.0]])


def test_images_of_a_map_that_was_loaded_before_are_not_driven_in_this_run() -> None:
    run = runs.at(3, runs.node(0, cause=Cause.LOAD))
    poses = [(step, 0.1 * step, np.array([float(step), 0.0, 0.0])) for step in range(6)]
    timeline = Timeline.of(run, poses)
    assert len(timeline.frames) == 2
    assert timeline.frames.pose(0) == pytest.approx([0.0, 0.0, 0.0])
    assert timeline.start_s == pytest.approx(0.4)
