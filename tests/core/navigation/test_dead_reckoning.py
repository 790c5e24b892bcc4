"""A robot before a door that was open when the map was made: by odometry it knows where it is."""

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, EdgePruned
from ltvn_core.graph.localiser import LOCAL, Localisation
from ltvn_core.graph.operators import pose_row
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.dead_reckoning import DeadReckoning
from ltvn_core.navigation.events import Tick
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.obstruction_finder import ObstructionFinder
from ltvn_core.navigation.perception import Perception
from ltvn_core.types import NodeId
from tests.core.navigation.sighted_world import NEAR_DOOR, DoorWorld, door_world

BEFORE_DOOR = (2.2, 1.0)


class Reckoner:
    """A robot that reckons in the world of two doors."""

    def __init__(self, maintenance: str = "persistent") -> None:
        self.place: DoorWorld = door_world(maintenance)
        parts = self.place.graph, self.place.keyframes, self.place.predictor, self.place.system
        context = NavigationContext.create(*parts, np.random.default_rng(0), self.place.robot.spec)
        self.motion = MotionExecutor(self.place.robot, 0, ROBUST.recovering)
        perception = Perception(self.motion, self.place.predictor, context.matcher, lambda _: None)
        self.reckoning = DeadReckoning(context, self.motion, perception)
        driver = AttemptDriver(self.motion, perception, ROBUST.driving, self.place.robot.spec)
        self.depth = ObstructionFinder(context, self.motion, perception, driver)
        self.goal = self.place.nearest(*BEFORE_DOOR)

    def has_arrived(self, source: NodeId, target: NodeId) -> bool:
        """Tell whether the robot, which does not recognise the target, holds to have driven an edge to its end."""
        return self.reckoning.arrive((source, target), is_recognised=False, fits_depth=self.depth.fits_depth)

    def arrive(self) -> None:
        """Recognise the place half a metre before the goal, and drive on to it."""
        place, goal = self.place, self.place.poses[self.goal]
        place.robot.pose = compose(goal, np.array([-0.5, 0.05, 0.0]))
        first = place.nearest(*place.robot.pose[:2])
        waypoint = relative(place.robot.pose, place.poses[first])
        self.reckoning.recognise(Localisation(first, 0.0, 0.9, waypoint, None, np.inf, LOCAL))
        for event in self.motion.drive_straight(0.5, 0.25):
            if isinstance(event, Tick):
                place.robot.advance()


def only_way_to(robot: Reckoner, target: NodeId, *, leads_to: NodeId | None = None) -> NodeId:
    """Leave one edge to a node, which was never driven, and return where it begins; a false one leads elsewhere."""
    place = robot.place
    for near in [*place.graph.predecessors(target), *place.graph.successors(target)]:
        for edge in ((near, target), (target, near)):
            if edge in place.graph.edges:
                place.graph.apply(EdgePruned(*edge, Cause.HAND))
    source = place.nearest(0.8, 1.0)
    waypoint = pose_row(relative(place.poses[source], place.poses[target if leads_to is None else leads_to]))
    place.graph.apply(EdgeAdded(Edge(source, target, waypoint, Belief(0.9, 1.4, 0.02)), Cause.HAND))
    return source


def test_before_a_closed_door_the_robot_knows_by_odometry_where_it_is() -> None:
    robot = Reckoner()
    robot.arrive()
    robot.place.change(NEAR_DOOR)
    found = robot.reckoning.localise()
    assert found is not None
    assert found.node is not None
    assert robot.place.poses[found.node][:2] == pytest.approx(robot.place.robot.pose[:2], abs=0.2)
    assert robot.reckoning.is_at(robot.goal)
    assert not robot.reckoning.is_at(robot.place.nearest(0.8, 3.3))


def test_where_everything_looks_as_it_did_reckoning_says_nothing() -> None:
    robot = Reckoner()
    robot.arrive()
    assert robot.reckoning.localise() is None
    assert not robot.reckoning.is_at(robot.goal)


def test_a_robot_that_never_recognised_a_place_knows_nothing() -> None:
    robot = Reckoner()
    robot.place.put(*BEFORE_DOOR)
    robot.place.change(NEAR_DOOR)
    assert robot.reckoning.localise() is None


def test_a_system_without_presence_does_not_reckon() -> None:
    robot = Reckoner("robust")
    robot.arrive()
    robot.place.change(NEAR_DOOR)
    assert robot.reckoning.localise() is None
    assert not robot.reckoning.is_at(robot.goal)


def test_who_drives_to_a_place_that_looks_different_now_has_arrived_and_is_there() -> None:
    robot = Reckoner()
    robot.arrive()
    robot.place.change(NEAR_DOOR)
    before = max(node for node in robot.place.graph.nodes if node < robot.goal)
    assert robot.has_arrived(before, robot.goal)
    found = robot.reckoning.take_arrival()
    assert found is not None
    assert found.node == robot.goal
    assert robot.reckoning.take_arrival() is None, "It may be somewhere else by now."


def test_at_the_end_of_an_edge_that_alone_says_where_it_leads_there_is_no_arrival() -> None:
    robot = Reckoner()
    robot.arrive()
    robot.place.change(NEAR_DOOR)
    stranger = robot.place.nearest(0.8, 3.3)
    source = only_way_to(robot, stranger, leads_to=robot.goal)
    assert robot.reckoning.is_at(stranger)
    assert not robot.has_arrived(source, stranger)


def test_a_place_that_is_not_recognised_is_told_by_depth() -> None:
    robot = Reckoner()
    robot.arrive()
    assert robot.has_arrived(only_way_to(robot, robot.goal), robot.goal)


def test_a_place_where_most_of_what_stands_around_is_new_is_not_told_by_depth() -> None:
    robot = Reckoner()
    robot.arrive()
    robot.place.change([[2.7, 0.2], [2.7, 1.9]])
    assert not robot.has_arrived(only_way_to(robot, robot.goal), robot.goal)
