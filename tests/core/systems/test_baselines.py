"""SPTM and ViNG keep every image, join them by their own rules, and find their way by them."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.evaluation.query_run import judge_goal_reached, run_query
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import GLOBAL, LOCAL, LocalisationPrior
from ltvn_core.graph.ltvn import reachable_nodes
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.network.training_data import temporal_rules
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.systems import temporal_distance
from ltvn_core.systems.registry import open_system
from ltvn_core.systems.system_table import SPTM, VING
from ltvn_core.systems.temporal_closeness import (
    MAX_NODES_AHEAD,
    MAX_SHORTCUTS,
    MEDIAN_WINDOW,
    MIN_STEPS_APART,
    choose_farthest_close_node,
    select_shortcuts,
)
from ltvn_core.systems.temporal_distance import EDGE_STEPS, reachability_of_steps, temporal_distances
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, TemporalPredictor, observation_at, one_room, tour
from tests.repository import DEMO_DRIVE

ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 3.2), (0.7, 0.7), (2.0, 0.7)]
IMAGES = list(tour(ROUND, spins=False))
FRAMES = [seen.step for seen in IMAGES]
BOTH = pytest.mark.parametrize("rival", [SPTM.factory, VING.factory])


def mapped(
    system: NavigationSystem, images: list[Observation], predictor: FlatPredictor
) -> tuple[TopologicalGraph, KeyframeStore, Matcher]:
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(system.build(images, keyframes, predictor, rng=np.random.default_rng(0)))
    return graph, keyframes, Matcher(predictor, keyframes, system.method.matching)


@BOTH
def test_every_image_is_a_node_and_each_is_joined_to_the_next(rival) -> None:  # noqa: ANN001
    shuffled = [IMAGES[k] for k in np.random.default_rng(1).permutation(len(IMAGES))]
    graph, keyframes, _ = mapped(rival(ROBUST), shuffled, FlatPredictor(one_room()))
    assert list(graph.nodes) == list(keyframes.frames) == FRAMES
    assert set(itertools.pairwise(FRAMES)) <= set(graph.edges)
    assert not graph.reserve
    assert reachable_nodes(graph, 0) == set(FRAMES)


@BOTH
def test_a_baseline_refuses_what_algorithm_1_refuses(rival) -> None:  # noqa: ANN001
    predictor = FlatPredictor(one_room())
    with pytest.raises(MapError, match="empty"):
        mapped(rival(ROBUST), [], predictor)
    with pytest.raises(MapError, match="goal frames"):
        rival(ROBUST).build(IMAGES, KeyframeStore(predictor), predictor, rng=np.random.default_rng(0), goals=[1])


@BOTH
def test_one_image_is_a_map_of_one_node(rival) -> None:  # noqa: ANN001
    graph, _, _ = mapped(rival(PAPER), IMAGES[:1], FlatPredictor(one_room()))
    assert (len(graph.nodes), len(graph.edges)) == (1, 0)


def test_sptms_shortcuts_join_places_seen_twice_both_ways() -> None:
    graph, _, _ = mapped(SPTM.factory(ROBUST), IMAGES, FlatPredictor(one_room()))
    row = {frame: k for k, frame in enumerate(FRAMES)}
    apart = {(a, b): abs(row[a] - row[b]) for a, b in graph.edges}
    assert all((b, a) in graph.edges for a, b in graph.edges)
    assert all(gap == 1 or gap > MIN_STEPS_APART for gap in apart.values())
    assert max(apart.values()) > len(IMAGES) / 2  # The last leg repeats the first.
    assert Planner(graph, ROBUST.planning, weight=SPTM.factory(ROBUST).edge_weight).plan(0, FRAMES[-1]).cost < 20


def test_sptm_takes_at_most_two_thousand_shortcuts_and_those_the_closest() -> None:
    count = 150
    scores = np.random.default_rng(0).uniform(0.6, 0.7, (count, count)).astype(np.float32)
    for shift in range(40):
        scores[20 + shift, 80 + shift] = scores[80 + shift, 20 + shift] = 0.9
    found = list(select_shortcuts(scores))
    assert len(found) == len(set(found)) == MAX_SHORTCUTS
    assert all(b - a > MIN_STEPS_APART for a, b in found)
    assert {(20 + shift, 80 + shift) for shift in range(MEDIAN_WINDOW, 30)} <= set(found[:45])


def test_a_single_likeness_is_no_shortcut() -> None:
    scores = np.zeros((100, 100), np.float32)
    scores[20, 80] = scores[80, 20] = 1.0
    assert list(select_shortcuts(scores)) == []
    assert list(select_shortcuts(np.ones((MIN_STEPS_APART + 1, MIN_STEPS_APART + 1), np.float32))) == []


def test_sptm_drives_to_the_farthest_close_node_ahead() -> None:
    path = list(range(20))
    assert choose_farthest_close_node(path, lambda node: 0.96 if node <= 4 else 0.5) == 4
    assert choose_farthest_close_node(path, lambda node: 1.0) == MAX_NODES_AHEAD
    assert choose_farthest_close_node(path, lambda node: 0.9) == 1
    assert choose_farthest_close_node(path[:2], lambda node: 1.0) == 1


def test_sptm_looks_along_the_last_path_first_and_then_for_the_middle_of_the_best() -> None:
    images = [observation_at(np.array([0.6 + 0.1 * k, 1.0, 0.0]), k) for k in range(30)]
    system, predictor = SPTM.factory(ROBUST), TemporalPredictor(one_room())
    graph, _, matcher = mapped(system, images, predictor)
    here = predictor.encode([observation_at(np.array([2.6, 1.0, 0.0]), 99)])
    fix = system.localise(here, graph, LocalisationPrior(tuple(range(17, 30))), matcher)
    assert (fix.node, fix.scope) == (20, LOCAL)
    fix = system.localise(here, graph, LocalisationPrior((0, 1, 2)), matcher)
    assert (fix.node, fix.scope) == (20, GLOBAL)
    assert system.localise(here, graph, LocalisationPrior(tuple(range(17, 30)), doubted={20}), matcher).node in (19, 21)
    assert system.localise(here, graph, LocalisationPrior((0, 1, 2), doubted={20}), matcher).node is None
    nowhere = predictor.encode([observation_at(np.array([2.6, 3.0, 0.0]), 99)])
    assert system.localise(nowhere, graph, LocalisationPrior(), matcher).node is None


def test_sptm_is_at_the_middle_one_of_five_that_look_alike() -> None:
    images = [observation_at(np.array([0.6 + 0.01 * k, 1.0, 0.0]), k) for k in range(30)]
    system, predictor = SPTM.factory(ROBUST), TemporalPredictor(one_room())
    graph, _, matcher = mapped(system, images, predictor)
    assert system.localise(predictor.encode([images[-1]]), graph, LocalisationPrior(), matcher).node == 27


def test_vings_edges_weigh_the_steps_between_their_images() -> None:
    images = [observation_at(np.array([0.6 + 0.1 * k, 1.0, 0.0]), 3 * k) for k in range(30)]
    system = VING.factory(ROBUST)
    graph, _, _ = mapped(system, images, TemporalPredictor(one_room()))
    for (source, target), edge in graph.edges.items():
        steps = abs(source - target) / 3
        assert steps <= EDGE_STEPS + 1e-6
        assert system.edge_weight(edge.belief) == pytest.approx(steps)
    assert (0, 3 * int(EDGE_STEPS)) in graph.edges
    path = Planner(graph, ROBUST.planning, weight=system.edge_weight).plan(0, 87)
    assert path.cost == pytest.approx(29)


def test_ving_joins_a_drive_where_the_network_sees_no_way() -> None:
    images = [observation_at(np.array([0.6, 1.0, 0.0]), 0), observation_at(np.array([4.0, 3.0, 3.0]), 1)]
    for both in (True, False):
        system = VING.factory(replace(ROBUST, matching=replace(ROBUST.matching, reverse_within=1.5 if both else 0.0)))
        graph, _, _ = mapped(system, images, FlatPredictor(one_room()))
        assert set(graph.edges) == ({(0, 1), (1, 0)} if both else {(0, 1)})
        assert system.edge_weight(graph.edges[0, 1].belief) == pytest.approx(1.0)


def test_ving_is_where_the_temporal_distance_is_least_or_nowhere() -> None:
    images = [observation_at(np.array([0.6 + 0.1 * k, 1.0, 0.0]), k) for k in range(30)]
    system, predictor = VING.factory(ROBUST), TemporalPredictor(one_room())
    graph, _, matcher = mapped(system, images, predictor)
    fix = system.localise(
        predictor.encode([observation_at(np.array([1.41, 1.0, 0.0]), 99)]), graph, LocalisationPrior(), matcher
    )
    assert fix.node == 8
    assert fix.margin == pytest.approx(0.8, abs=0.01)
    nowhere = predictor.encode([observation_at(np.array([2.6, 3.0, 0.0]), 99)])
    assert system.localise(nowhere, graph, LocalisationPrior(), matcher).node is None


def test_the_labels_and_the_map_mean_the_same_by_a_step() -> None:
    assert temporal_distance.TAU_STEPS == temporal_rules.TAU_STEPS


def test_steps_and_closeness_are_inverse_and_the_navigator_asks_in_steps() -> None:
    assert float(temporal_distances(reachability_of_steps(4.0))) == pytest.approx(4.0)
    assert math.isfinite(temporal_distances(0.0))
    method = VING.factory(ROBUST).method
    assert method.judging.success_reachability == pytest.approx(reachability_of_steps(EDGE_STEPS))
    assert method.driving.lost_reachability < method.driving.departure_reachability
    assert VING.factory(PAPER).method.driving.departure_reachability == 0
    assert SPTM.factory(ROBUST).method == ROBUST


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ltvn", "sptm", "ving"])
def test_each_system_reaches_goals_in_the_demo_apartment(name: str, images: list[Observation]) -> None:
    scene = load_scene("demo")
    predictor = OraclePredictor(scene.clearance)
    keyframes, system = KeyframeStore(predictor), open_system(name, ROBUST)  # type: ignore[arg-type]
    graph = TopologicalGraph(system.build(images, keyframes, predictor, rng=np.random.default_rng(0)))
    poses = {seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None}
    nodes = list(graph.nodes)
    simulation = open_simulation("demo", seed=0, first_step=10_000, start=poses[nodes[0]])
    robot = simulation.robot
    navigator = Navigator(robot, graph, keyframes, predictor, system, np.random.default_rng(0))
    for query, goal in enumerate([nodes[len(nodes) // 3], nodes[2 * len(nodes) // 3]]):
        episode = run_query(
            navigator,
            goal,
            query,
            advance=lambda: robot.advance(0.1),
            verdict=lambda q=query, g=goal: judge_goal_reached(q, robot.exact_pose, poses[g]),
        )
        assert episode.reached, episode
    robot.close()


@pytest.fixture(scope="module", name="images")
def demo_drive() -> list[Observation]:
    recording = Recording.open(DEMO_DRIVE)
    return [recording.observation(frame) for frame in recording.frames[:240]]
