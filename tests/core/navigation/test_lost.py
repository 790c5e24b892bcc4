"""A robot that does not know where it is looks around, finds itself, or gives up."""

import math
from dataclasses import replace

import numpy as np

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.graph.deltas import Cause, NodeAdded
from ltvn_core.navigation.events import GraphChanged, Localised, Outcome
from tests.core.navigation.mapped_world import PRESETS, events_of, mapped_corridor


@PRESETS
def test_a_lost_robot_turns_looks_and_gives_up(method: Method) -> None:
    place = mapped_corridor(replace(method, recovering=replace(method.recovering, give_up_after_looks=8)))
    place.robot.pose = np.array([2.0, 3.5, math.pi / 2])
    place.predictor.sight_m = 0.3
    episode, events = place.go(6)
    assert episode.outcome == Outcome.LOST
    assert all(event.node is None for event in events_of(Localised, events))
    assert abs(place.robot.pose[2] - math.pi / 2) > 0.1


def test_a_lost_robot_that_turns_far_enough_finds_itself() -> None:
    place = mapped_corridor(ROBUST)
    place.robot.pose = np.array([0.7, 1.0, math.pi])
    assert place.go(4)[0].reached


def test_what_a_lost_robot_sees_becomes_a_node() -> None:
    place = mapped_corridor(PAPER)
    place.robot.pose = np.array([0.6, 1.0, 0.9])
    place.method = replace(PAPER, localising=replace(PAPER.localising, distance=0.5))
    place.method = replace(place.method, building=replace(PAPER.building, connect_distance=1.2))
    episode, events = place.go(4)
    added = [event.delta for event in events_of(GraphChanged, events) if isinstance(event.delta, NodeAdded)]
    assert added
    assert added[0].cause is Cause.NOVEL
    assert added[0].node.id in place.graph.nodes
    assert added[0].node.id in place.keyframes
    assert episode.reached
