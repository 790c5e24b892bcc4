"""Where the robot is: the way there tells places apart that look the same, and each image is found, or is nowhere."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import ROBUST, Method
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached, run_query
from ltvn_core.geometry import relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.events import Outcome
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.navigation.perception import MotionExecutor, PassiveLocaliser, Perception
from ltvn_core.navigation.query import NavigationContext, QueryState
from ltvn_core.types import Features, Prediction
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, box, observation_at, one_room, tour
from tests.core.navigation.blind_world import BlindedRobot, DepthPredictor

APART = np.array([7.0, 0.0, 0.0, 0.0])
WAY = [(0.6, 1.0), (13.4, 1.0), (0.6, 1.0)]
"""There and back along a corridor."""
CREDULOUS = replace(ROBUST, localising=replace(ROBUST.localising, follow_places=False))
"""Believes to be at a place by its looks alone."""


@dataclass
class AliasedPredictor(DepthPredictor):
    """Cannot tell the stretch of the corridor from 3 m to 5 m from the one from 10 m to 12 m."""

    def predict(self, sources: Features, targets: Features) -> Prediction:
        sources, targets = (np.asarray(each, np.float64) for each in np.broadcast_arrays(sources, targets))
        answer = super().predict(sources, targets)
        for shift in (APART, -APART):
            fooled = _inside(sources) & _inside(targets) & (np.abs(sources - shift - targets)[:, 0] < 2)
            other = super().predict(sources[fooled], targets[fooled] + shift)
            answer.reachability[fooled], answer.waypoints[fooled] = other
        return answer


def _inside(features: Features) -> NDArray[np.bool_]:
    x = np.asarray(features[:, 0], np.float64)
    return ((x > 3) & (x < 5)) | ((x > 10) & (x < 12))


def drive(method: Method, start_x: float, *goals_x: float, sees: int = 100_000) -> tuple[QueryResult, TopologicalGraph]:
    """Drive along the corridor from goal to goal, with depth for some steps; return how the last query ended."""
    world = FlatWorld(np.array(box(14.0, 2.0)))
    images, predictor = list(tour(WAY)), AliasedPredictor(world)
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(images, keyframes, predictor, method, np.random.default_rng(0)))
    poses = {seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None}
    ahead = [node for node in graph.nodes if abs(poses[node][2]) < 0.1]
    goals = [min(ahead, key=lambda node: abs(poses[node][0] - goal_x)) for goal_x in goals_x]
    robot = BlindedRobot(world, [start_x, 1.0, 0.0], first_step=100_000)
    robot.blind = lambda pose, step: step > 100_000 + sees
    method = replace(method, maintain=False)
    navigator = Navigator(robot, graph, keyframes, predictor, ltvn_system(method), np.random.default_rng(0))
    episodes = [
        run_query(
            navigator,
            goal,
            number,
            advance=robot.advance,
            verdict=lambda goal=goal: judge_goal_reached(0, robot.pose, poses[goal]),
            consume=lambda event: None,
        )
        for number, goal in enumerate(goals)
    ]
    return episodes[-1], graph


def test_the_robot_passes_the_perceptual_alias_of_its_goal() -> None:
    assert not drive(CREDULOUS, 0.8, 11.0)[0].reached
    assert drive(ROBUST, 0.8, 11.0)[0].reached


def test_a_robot_that_could_be_at_its_goal_or_at_its_alias_drives_on_to_find_out() -> None:
    for start_x, goal_x in ((4.0, 4.0), (11.0, 4.0), (4.0, 11.0)):
        query, _ = drive(ROBUST, start_x, goal_x)
        assert (query.outcome, query.reached) == (Outcome.ARRIVED, True)


def test_a_robot_that_has_lost_its_depth_does_not_drive_blind_to_find_out() -> None:
    query, _ = drive(ROBUST, 11.0, 8.0, sees=3)
    assert (query.outcome, query.path_m) == (Outcome.LOST, 0.0)


def test_a_robot_that_arrived_still_knows_where_it_is_at_the_next_goal() -> None:
    (goes_on, _), (begins, _) = drive(ROBUST, 0.8, 11.0, 12.6), drive(ROBUST, 11.0, 12.6)
    assert goes_on.reached
    assert goes_on.steps < begins.steps / 2


def test_no_edge_leads_from_a_place_to_its_perceptual_alias() -> None:
    _, graph = drive(ROBUST, 0.8, 1.5)
    x = {node: waypoint.odometry[0] for node, waypoint in graph.nodes.items()}
    assert all(abs(x[source] - x[target]) < 2 for source, target in graph.edges)


def test_a_node_from_which_attempts_keep_failing_is_doubted_until_it_is_trusted_again() -> None:
    world = one_room()
    predictor, graph = FlatPredictor(world), TopologicalGraph()
    keyframes, system, robot = KeyframeStore(predictor), ltvn_system(ROBUST), FlatRobot(world, [1.0, 1.0, 0.0])
    matcher = Matcher(predictor, keyframes, ROBUST.matching)
    planner = Planner(graph, ROBUST.planning, weight=system.edge_weight)
    rng = np.random.default_rng(0)
    context = NavigationContext(graph, keyframes, system, rng, robot.spec, matcher, planner, Bystanders())
    motion = MotionExecutor(robot, 0, ROBUST.recovering)
    query = QueryState(context, motion, Perception(motion, predictor, matcher), goal=5, number=0)
    for _ in range(ROBUST.localising.doubt_after_failures):
        assert not query.doubted
        query.record_failure_from(3)
    assert query.doubted == {3}
    query.begin_anew()
    assert not query.doubted


FIRST_DRIVE = [(0.7, 0.7), (2.7, 0.7)]


def test_a_second_drive_is_found_in_the_map_of_the_first_and_elsewhere_is_nowhere() -> None:
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    images = list(tour(FIRST_DRIVE, spins=False))
    graph = TopologicalGraph(build(images, keyframes, predictor, ROBUST, np.random.default_rng(0)))
    localiser = PassiveLocaliser(graph, keyframes, predictor, ltvn_system(ROBUST))
    for x in np.arange(0.8, 2.6, 0.3):
        pose = np.array([x, 0.75, 0.1])
        found = localiser.localise(observation_at(pose, 1000 + int(10 * x), relative(np.array([3.0, 1.0, 2.0]), pose)))
        assert found is not None
        assert found.node is not None
        place = keyframes.observation(found.node).odometry
        assert np.hypot(*(place - pose)[:2]) < 0.72
    away = localiser.localise(observation_at(np.array([4.2, 3.2, 1.5]), 2000))
    assert away is not None
    assert away.node is None
