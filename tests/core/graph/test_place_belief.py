"""Two rooms that look the same: which of them it is, what was seen on the way tells."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.config import ROBUST
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded, NodeDropped
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.place_belief import LIKELY, SURE, PlaceBelief
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Features, Observation, Pose, Prediction
from tests.core.flat_world import observation_at

STEP_M, COUNT = 0.5, 24
PLACES = np.array([[STEP_M * k, 0.0, 0.0] for k in range(COUNT)])
"""Nodes along a corridor of 12 m."""
ALIAS_M = 6.0
"""It looks the same so much farther on, but for its first metres."""
UNIQUE_M = 2.0


def corridor() -> TopologicalGraph:
    graph = TopologicalGraph()
    for frame, pose in enumerate(PLACES):
        graph.apply(NodeAdded(node_from_observation(observation_at(pose, frame, pose)), Cause.BUILD))
    for k in range(COUNT - 1):
        way = pose_row(relative(PLACES[k], PLACES[k + 1]))
        graph.apply(EdgeAdded(Edge(k, k + 1, way, Belief(0.9, STEP_M, 0.02)), Cause.BUILD))
    return graph


def looks(x_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where places seem to be, if all but the first metres of both halves look the same."""
    return np.where(x_m < UNIQUE_M, x_m, UNIQUE_M + (x_m - UNIQUE_M) % ALIAS_M)


class Eye:
    """A predictor that cannot tell a place of the corridor from its alias. Features are places along it, (N, 1)."""

    fingerprint = "eye"
    camera = LOCOBOT.camera

    def encode(self, observations: Sequence[Observation]) -> Features:
        return np.array([[seen.odometry[0]] for seen in observations])

    def predict(self, sources: Features, targets: Features) -> Prediction:
        seen = (looks(np.asarray(targets, np.float64)) - looks(np.asarray(sources, np.float64)))[:, 0]
        waypoints = np.stack([seen, np.zeros(len(seen)), np.zeros(len(seen))], axis=1)
        return Prediction(np.where(distance(waypoints) < 1.5, 0.99, 0.02), waypoints)


def matcher() -> Matcher:
    keyframes = KeyframeStore(Eye())
    keyframes.add([observation_at(pose, frame, pose) for frame, pose in enumerate(PLACES)])
    return Matcher(Eye(), keyframes, ROBUST.matching)


MATCHER = matcher()


def lost(graph: TopologicalGraph | None = None) -> PlaceBelief:
    return PlaceBelief(graph or corridor(), MATCHER)


def matches_at(x_m: float, nodes: tuple[int, ...]) -> Matches:
    """Compare what is seen at x with nodes."""
    return MATCHER.match(np.array([[x_m]]), nodes)


def drive(belief: PlaceBelief, way_m: list[float], odometry_began_at_m: float = 0.0) -> Pose:
    """Let a belief see what there is on a way; return the odometry at its end."""
    odometry = np.zeros(3)
    for x_m in way_m:
        odometry = np.array([x_m - odometry_began_at_m, 0.0, 0.0])
        found = matches_at(x_m, belief.nodes_to_ask(odometry))
        belief.see(odometry, found, (found.distances < 1.0) & (found.reachability > 0.5))
    return odometry


def believed_x_m(belief: PlaceBelief, odometry: Pose) -> tuple[float, float]:
    """Return where along the corridor the belief puts the robot, and how probable that is."""
    place = belief.best(odometry)
    assert place is not None
    nearest = next(iter(place.nodes))
    return float(PLACES[nearest][0] - place.nodes[nearest][0]), place.probability


def test_one_image_of_an_alias_leaves_both_places_open() -> None:
    belief = lost()
    _, probability = believed_x_m(belief, drive(belief, [9.0], 9.0))
    assert probability < 0.7


def test_who_came_from_somewhere_unique_knows_which_of_the_two_it_is() -> None:
    for start_m in (0.5, 1.2):
        belief = lost()
        way = [start_m + 0.7 * k for k in range(8)]
        x_m, probability = believed_x_m(belief, drive(belief, way, start_m))
        assert abs(x_m - way[-1]) < 0.3
        assert probability > 0.75


def test_of_two_equal_places_the_one_with_more_images_is_not_likelier() -> None:
    graph = corridor()
    for node in (7, 8, 9):
        graph.apply(NodeDropped(node, Cause.HAND))  # Where the robot is, the map has fewer images.
    belief = lost(graph)
    way = [3.2, 3.5, 3.8, 4.1, 4.4, 4.7, 4.4, 4.1, 3.8, 3.5, 3.2]
    _, probability = believed_x_m(belief, drive(belief, way, 3.2))
    assert probability < SURE


def test_who_drives_out_of_the_alias_finds_out_where_it_was() -> None:
    belief = lost()
    way = [3.0 - 0.5 * k for k in range(6)]  # From its alias the way back would lead into what looks otherwise.
    x_m, probability = believed_x_m(belief, drive(belief, way, 3.0))
    assert abs(x_m - way[-1]) < 0.3
    assert probability > 0.9


def test_a_robot_carried_off_is_found_again() -> None:
    belief = lost()
    drive(belief, [0.5 + 0.5 * k for k in range(6)])
    belief.forget()
    x_m, _ = believed_x_m(belief, drive(belief, [0.5, 1.0, 1.5], 0.0))
    assert abs(x_m - 1.5) < 0.3


def test_who_knows_where_it_is_asks_only_the_nodes_around() -> None:
    belief = lost()
    assert len(belief.nodes_to_ask(np.zeros(3))) == COUNT
    odometry = drive(belief, [0.5 + 0.5 * k for k in range(6)])
    assert 0 < len(belief.nodes_to_ask(odometry)) < COUNT / 2


def test_a_node_that_is_new_in_the_map_is_asked_too() -> None:
    graph = corridor()
    belief = lost(graph)
    drive(belief, [0.5])
    graph.apply(NodeAdded(node_from_observation(observation_at(np.array([3.2, 0.0, 0.0]), 99)), Cause.NOVEL))
    belief.forget()
    assert 99 in belief.nodes_to_ask(np.zeros(3))


def test_a_doubted_place_is_not_the_best() -> None:
    belief = lost()
    odometry = drive(belief, [9.0], 9.0)
    first = belief.best(odometry)
    assert first is not None
    nearest = next(iter(first.nodes))
    other = belief.best(odometry, doubted={nearest})
    assert other is not None
    assert abs(PLACES[next(iter(other.nodes))][0] - PLACES[nearest][0]) == ALIAS_M


def test_nothing_that_resembles_a_node_leaves_no_place() -> None:
    belief = lost()
    nodes = belief.nodes_to_ask(np.zeros(3))
    nothing = matches_at(1.0, nodes).with_reachability(np.zeros(len(nodes)))
    belief.see(np.zeros(3), nothing, np.zeros(len(nodes), bool))
    assert belief.best(np.zeros(3)) is None


def seen_once(x_m: float, reachability: float) -> float:
    """Return the probability of a place that one image resembles with r."""
    belief = lost()
    found = matches_at(x_m, belief.nodes_to_ask(np.zeros(3)))
    found = found.with_reachability(np.where(found.reachability > 0.5, reachability, 0.02))
    belief.see(np.zeros(3), found, (found.distances < 1.0) & (found.reachability > 0.5))
    return believed_x_m(belief, np.zeros(3))[1]


def test_one_image_makes_a_place_likely_only_if_its_nodes_are_surely_recognised() -> None:
    assert seen_once(0.5, 0.99) > LIKELY >= seen_once(0.5, 0.6)


def test_images_of_a_place_that_has_changed_do_not_make_another_place_likelier() -> None:
    belief = lost()
    odometry = drive(belief, [0.5 + 0.5 * k for k in range(6)])
    before = believed_x_m(belief, odometry)
    for k in range(1, 8):
        odometry = np.array([3.0 + 0.3 * k, 0.0, 0.0])
        nodes = belief.nodes_to_ask(odometry)
        unlike = matches_at(1.0, nodes).with_reachability(np.full(len(nodes), 0.02))
        belief.see(odometry, unlike, np.zeros(len(nodes), bool))
    assert believed_x_m(belief, odometry)[1] == pytest.approx(before[1], abs=0.2)


def test_a_node_is_where_most_of_the_likely_places_put_it() -> None:
    belief = lost()
    odometry = drive(belief, [0.5 + 0.5 * k for k in range(6)])
    node = int(np.argmin(np.abs(PLACES[:, 0] - 3.5)))
    there = relative(np.array([3.0, 0.0, 0.0]), PLACES[node])
    assert belief.probability_at(odometry, node, there) > 0.8
    assert belief.probability_at(odometry, node, there + np.array([3.0, 0.0, 0.0])) < 0.1
