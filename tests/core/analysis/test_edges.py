"""The edge microscope: the life of an edge, and where its waypoint lies in the picture."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.analysis.answer import pole_in_image
from ltvn_core.analysis.edge_story import edge_story
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.data.recording.reader import Recording
from ltvn_core.graph.deltas import Cause, NodeDropped
from ltvn_core.navigation.events import AttemptEnd, GraphChanged
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.analysis import example_runs as runs
from tests.repository import DEMO_DRIVE

LENS = LOCOBOT.camera


def test_every_attempt_is_told_and_whether_it_counted() -> None:
    story = edge_story(runs.timeline(), 1, 2)
    started = [each.started for each in story.attempts]
    assert [
        (begun.attempt, begun.query, each.failed, (begun.query, begun.attempt) in story.counted)
        for begun, each in zip(started, story.attempts, strict=True)
    ] == [(2, 0, True, True), (3, 0, True, False), (4, 1, True, True)]
    first, ended = story.attempts[0], story.attempts[0].ended
    assert first.plan is not None
    assert first.plan.localised is not None
    assert ended is not None
    assert (first.started.frame, ended.frame, ended.end) == (40, 60, AttemptEnd.COLLISION)
    assert (ended.distance, ended.reachability) == (0.9, 0.1)
    assert first.plan.localised.node == 1


def test_an_attempt_has_no_verdict_before_it_ended() -> None:
    (under_way,) = edge_story(runs.timeline(), 1, 2, Instant(50, 5.0)).attempts
    assert (under_way.ended, under_way.end) == (None, None)


def test_an_edge_that_comes_back_lives_twice_and_one_goes_with_its_node() -> None:
    dropped = GraphChanged(NodeDropped(2, Cause.HAND))
    run = [*runs.two_failures(), *runs.at(190, runs.edge(1, 2, cause=Cause.HAND)), *runs.at(195, dropped)]
    story = edge_story(Timeline.of(run), 1, 2)
    assert [row.cause for row in story.rows if row.is_addition] == [Cause.BUILD, Cause.HAND]
    assert sum(row.is_removal for row in story.rows) == 2
    assert story.end is not None
    assert (story.life[0].cause, story.end.node, story.end.instant.step) == (Cause.HAND, 2, 195)


def test_an_edge_ends_with_its_map() -> None:
    again = [*runs.at(200, *(each.event for each in runs.square()))]
    story = edge_story(Timeline.of([*runs.square(), *again]), 1, 2)
    assert [(row.is_addition, row.whole_map) for row in story.rows] == [(True, False), (False, True), (True, False)]


def test_without_the_map_before_it_an_edge_has_attempts_but_no_life() -> None:
    story = edge_story(Timeline.of([stamped for stamped in runs.two_failures() if stamped.step >= 20]), 1, 2)
    assert (story.life, story.last, len(story.attempts)) == ((), None, 3)


def test_all_attempts_of_a_real_drive_end_in_the_belief_of_the_final_map() -> None:
    recording = Recording.open(DEMO_DRIVE)
    timeline, graph = Timeline.of(recording.events), recording.final_graph()
    driven = [edge for edge in graph.edges.values() if edge.attempts]
    assert driven
    for edge in driven:
        story = edge_story(timeline, edge.source, edge.target)
        assert story.last == edge
        assert len(story.counted) == edge.attempts


def test_the_waypoint_lies_where_the_camera_sees_the_floor_at_that_depth() -> None:
    recording = Recording.open(DEMO_DRIVE)
    ahead, left = 2.0, 0.3
    pole = pole_in_image(np.array([ahead, left, 0.5]), LENS)
    assert pole is not None
    column, row = map(int, pole.foot)
    looks = (recording.observation(frame).require_depth("the test") for frame in recording.frames[::20])
    depths = np.array([depth[row, column] for depth in looks])
    # Nothing lies below the floor, and often nothing stands on it; half a row of pixels is 5 cm there.
    assert max(depths) < ahead + 0.06
    assert np.mean(np.abs(depths - ahead) < 0.06) > 0.1


@pytest.mark.parametrize("waypoint", [(-1.0, 0.0, 0.0), (0.5, 2.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_waypoint_behind_or_aside_is_not_in_the_image(waypoint: tuple[float, float, float]) -> None:
    assert pole_in_image(np.array(waypoint), LENS) is None


def test_a_camera_that_looks_up_sees_the_floor_lower() -> None:
    level = pole_in_image(np.array([3.0, 0.0, 0.0]), LENS)
    up = pole_in_image(np.array([3.0, 0.0, 0.0]), replace(LENS, pitch_rad=0.1))
    assert level is not None
    assert up is not None
    assert up.foot[1] > level.foot[1]


def test_the_pole_over_a_near_waypoint_ends_below_the_image() -> None:
    pole = pole_in_image(np.array([1.0, 0.2, 0.0]), LENS)
    assert pole is not None
    assert pole.top[1] == LENS.height / 2 < LENS.height < pole.foot[1]
    assert pole.top[0] == pole.foot[0] < LENS.width / 2
