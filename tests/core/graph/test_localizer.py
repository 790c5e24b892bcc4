"""The nearest node, first around the plan, then anywhere, and how sure that is."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.geometry import agree, distance, relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded, PoseRow
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import (
    GLOBAL,
    LOCAL,
    NO_PRIOR,
    Localisation,
    LocalisationPrior,
    localise,
    near_enough,
    nearest_nodes,
)
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.operators import node_from_observation
from ltvn_core.graph.place_belief import AT_PLACE, BelievedPlace
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Features, Prediction
from tests.core.flat_world import FlatPredictor, observation_at, one_room

IMAGES = [observation_at(np.array([0.5 + 0.5 * k, 1.0, 0.0]), k) for k in range(8)]


def line(predictor: FlatPredictor, method: Method) -> tuple[Matcher, TopologicalGraph]:
    """Return a map of eight nodes in a row, 0.5 m apart."""
    keyframes = KeyframeStore(predictor)
    keyframes.add(IMAGES)
    graph = TopologicalGraph(NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in IMAGES)
    for k in range(7):
        edge = Edge(k, k + 1, PoseRow(0.5, 0.0, 0.0), Belief(0.9, 0.5, 0.02))
        graph.apply(EdgeAdded(edge, Cause.BUILD))
    return Matcher(predictor, keyframes, method.matching), graph


def fix_at(
    x: float, y: float = 1.0, yaw: float = 0.0, plan: tuple[int, ...] = (), method: Method = ROBUST
) -> Localisation:
    predictor = FlatPredictor(one_room())
    matcher, graph = line(predictor, method)
    image = predictor.encode([observation_at(np.array([x, y, yaw]), 99)])
    return localise(image, graph, LocalisationPrior(plan), matcher, config=method.localising)


@pytest.mark.parametrize("method", [ROBUST, PAPER], ids=["robust", "paper"])
def test_the_robot_is_at_the_nearest_node(method: Method) -> None:
    fix = fix_at(2.05, method=method)
    assert (fix.node, fix.scope) == (3, GLOBAL)
    assert fix.distance == pytest.approx(0.05)
    assert np.allclose(fix.waypoint, [-0.05, 0, 0])
    assert fix.runner_up == 4
    assert fix.margin == pytest.approx(0.4, abs=0.01)


def test_half_way_between_two_nodes_the_margin_is_small() -> None:
    assert fix_at(2.25).margin == pytest.approx(0.0, abs=0.01)


def test_the_neighbours_of_the_last_plan_come_first() -> None:
    fix = fix_at(2.05, plan=(4, 5))
    assert (fix.node, fix.scope) == (4, LOCAL)
    led_to = fix_at(2.05, plan=(2,))
    assert (led_to.node, led_to.scope) == (3, LOCAL), "an edge leads there from the plan"


def test_far_from_the_plan_the_whole_map_is_searched() -> None:
    fix = fix_at(0.5, plan=(6, 7))
    assert (fix.node, fix.scope) == (0, GLOBAL)


def test_nodes_of_the_plan_that_have_left_the_map_are_no_obstacle() -> None:
    assert fix_at(2.05, plan=(77, 78)).node == 3


def test_turned_away_the_robot_is_lost_but_the_best_node_is_reported() -> None:
    fix = fix_at(2.0, yaw=3.1)
    assert fix.node is None
    assert np.isfinite(fix.distance)


def test_in_an_empty_map_the_robot_is_lost() -> None:
    predictor = FlatPredictor(one_room())
    matcher, _ = line(predictor, ROBUST)
    fix = localise(predictor.encode([IMAGES[0]]), TopologicalGraph(), NO_PRIOR, matcher, config=ROBUST.localising)
    assert fix.node is None
    assert fix.distance == np.inf
    assert fix.runner_up is None


def test_a_node_that_is_surely_not_seen_comes_last_in_a_gallery_however_near_it_seems() -> None:
    class Unseeing(FlatPredictor):
        def predict(self, sources: np.ndarray, targets: np.ndarray):  # noqa: ANN202
            answer = super().predict(sources, targets)
            unseen = (targets[:, 3] == 3) | (np.broadcast_to(sources, targets.shape)[:, 3] == 3)
            answer.reachability[unseen] *= 0.01
            return answer

    for method in (ROBUST, PAPER):
        predictor = Unseeing(one_room())
        matcher, graph = line(predictor, replace(method, matching=PAPER.matching))
        ranked = nearest_nodes(predictor.encode([observation_at(np.array([2.05, 1.0, 0.0]), 99)]), graph, 8, matcher)
        assert [node for node, _ in ranked[:2]] == [4, 2]


def test_the_nodes_that_look_like_an_image_come_best_first() -> None:
    predictor = FlatPredictor(one_room())
    matcher, graph = line(predictor, ROBUST)
    ranked = nearest_nodes(predictor.encode([IMAGES[4]]), graph, 3, matcher)
    assert ranked[0][0] == 4
    assert {node for node, _ in ranked[1:]} == {3, 5}


class UnsurePredictor(FlatPredictor):
    """Gives pairs of images an r between 0.3 and 1."""

    def predict(self, sources: Features, targets: Features) -> Prediction:
        answer = super().predict(sources, targets)
        answer.reachability[:] = 0.65 + 0.35 * np.sin(1e3 * np.add(sources[:, 0], targets[:, 0]))
        return answer


@pytest.mark.parametrize("seed", range(8))
def test_at_a_believed_place_comparing_few_nodes_finds_what_comparing_all_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    predictor = UnsurePredictor(one_room())
    poses = np.column_stack([rng.uniform(0.5, 4.5, 150), rng.uniform(0.5, 3.5, 150), rng.uniform(-1, 1, 150)])
    images = [observation_at(pose, k) for k, pose in enumerate(poses)]
    keyframes = KeyframeStore(predictor)
    keyframes.add(images)
    matcher = Matcher(predictor, keyframes, ROBUST.matching)
    graph = TopologicalGraph(NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in images)
    here = np.array([2.5, 2.0, 0.0])
    features = predictor.encode([observation_at(here, 99)])
    expected = relative(here + rng.normal(0, 0.1, 3), poses)
    place = BelievedPlace(dict(enumerate(expected)), 0.9, is_recognised=True)

    fix = localise(features, graph, LocalisationPrior(place=place), matcher, config=ROBUST.localising)

    found = matcher.match(features, tuple(range(150)))
    agrees = agree(expected, found.waypoints, AT_PLACE) & near_enough(found, ROBUST.localising)
    scores = np.where(agrees, distance(expected) - 0.5 * np.log(found.reachability), np.inf)
    first, second = np.argsort(scores)[:2]
    assert np.count_nonzero(agrees) > 8
    assert (fix.node, fix.runner_up) == (first, second)
    assert fix.margin == pytest.approx(scores[second] - scores[first])
