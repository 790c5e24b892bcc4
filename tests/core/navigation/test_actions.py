"""Where an edge has an action, the robot waits at its source until the action is done, and goes on from its target."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from ltvn_core.analysis.manual_edits import connect_by_action
from ltvn_core.config import ROBUST, Method
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.graph.deltas import Cause, EdgePruned, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.operators import node_from_observation
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import (
    ActionBegun,
    ActionEnded,
    AttemptStarted,
    Event,
    Localised,
    NavigatorState,
    Outcome,
    QueryEnded,
    StateChanged,
    Tick,
)
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.types import Features, NodeId, Observation
from tests.core.flat_world import FlatPredictor, FlatWorld, observation_at, one_room
from tests.core.navigation.mapped_world import (
    PRESETS,
    MappedWorld,
    events_of,
    join_nodes,
    map_world,
    mapped_corridor,
    mapped_rooms,
)

WALL_M = 3.0
LIFT = "Take the lift to floor 2"


@dataclass
class Lift:
    """Carries the robot to the target some steps after it was called, without a turn of its wheels."""

    place: MappedWorld
    steps: int = 30
    works: bool = True
    begun: int = 0

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        self.begun += 1
        self._target = target
        self._left = self.steps

    def state(self) -> ActionState:
        self._left -= 1
        if self._left > 0:
            return ActionState.PENDING
        if self.works:
            odometry = self.place.robot.state().odometry.tolist()
            self.place.robot.put_down(self.place.poses[self._target].tolist(), odometry)
        return ActionState.DONE if self.works else ActionState.FAILED


def navigator(place: MappedWorld, actions: Lift | None) -> Navigator:
    parts = place.robot, place.graph, place.keyframes, place.predictor, ltvn_system(place.method)
    return Navigator(*parts, np.random.default_rng(0), actions=actions)


def go(place: MappedWorld, goal: NodeId, actions: Lift | None) -> tuple[QueryResult, list[Event]]:
    return place.go(goal, navigator=navigator(place, actions))


def two_floors(method: Method) -> tuple[MappedWorld, tuple[NodeId, NodeId]]:
    """Return two rooms without a way between them but a lift, and the edge that stands for it."""
    place = mapped_rooms(method)
    for key in list(place.graph.edges):
        if len({place.poses[end][0] < WALL_M for end in key}) > 1:
            place.graph.apply(EdgePruned(*key, Cause.HAND))
    wall = np.array([[[WALL_M, 0.0], [WALL_M, 4.0]]])
    place.robot.world = place.predictor.world = FlatWorld(np.concatenate([place.world.walls, wall]))
    lift = place.nearest(2.2, 2.0), place.nearest(3.8, 2.0)
    for delta in connect_by_action(place.graph, *lift, LIFT):
        place.graph.apply(delta)
    return place, lift


@PRESETS
def test_a_lift_takes_the_robot_to_a_goal_on_another_floor(method: Method) -> None:
    place, lift = two_floors(method)
    goal = place.nearest(5.2, 3.2)
    elevator = Lift(place)
    episode, events = go(place, goal, elevator)
    assert (episode.outcome, episode.reached) == (Outcome.ARRIVED, True)
    assert place.robot.collisions == 0
    (begun,) = events_of(ActionBegun, events)
    (ended,) = events_of(ActionEnded, events)
    assert (begun.source, begun.target, begun.action) == (*lift, LIFT)
    assert ended.succeeded
    assert ended.frame >= begun.frame + elevator.steps - 1
    assert StateChanged(NavigatorState.ACTING) in events
    for started in events_of(AttemptStarted, events):
        ends = {place.poses[each][0] < WALL_M for each in (started.source, started.target) if each is not None}
        assert len(ends) == 1
    after = place.graph.edges[lift]
    assert (after.attempts, after.successes, after.belief.mu) == (1, 1, pytest.approx(10.0))


def test_waiting_for_an_action_does_not_use_up_the_steps_of_a_query() -> None:
    place, _ = two_floors(ROBUST)
    slow = Lift(place, steps=ROBUST.recovering.step_limit + 100)
    assert go(place, place.nearest(5.2, 3.2), slow)[0].reached


def test_a_query_that_is_cancelled_during_an_action_ends() -> None:
    place, _ = two_floors(ROBUST)
    driving = navigator(place, Lift(place, steps=100_000))
    events: list[Event] = []
    for event in driving.query(place.nearest(5.2, 3.2), 0):
        if isinstance(event, Tick):
            place.robot.advance()
            continue
        events.append(event)
        if isinstance(event, ActionBegun):
            driving.cancel()
    (ended,) = events_of(ActionEnded, events)
    assert not ended.succeeded
    assert isinstance(events[-1], QueryEnded)
    assert events[-1].outcome is Outcome.CANCELLED


@PRESETS
def test_an_action_that_fails_is_not_tried_again_in_the_query(method: Method) -> None:
    place, lift = two_floors(method)
    elevator = Lift(place, works=False)
    episode, events = go(place, place.nearest(5.2, 3.2), elevator)
    assert episode.outcome == Outcome.NO_PATH
    assert elevator.begun == len(events_of(ActionEnded, events)) == 1
    assert lift in place.graph.edges


def test_without_a_performer_an_action_fails_at_once() -> None:
    place, lift = two_floors(ROBUST)
    before = place.graph.edges[lift]
    episode, events = go(place, place.nearest(5.2, 3.2), None)
    assert episode.outcome == Outcome.NO_PATH
    (ended,) = events_of(ActionEnded, events)
    assert not ended.succeeded
    assert ended.reason
    assert place.graph.edges[lift] == before


def test_after_a_failed_action_the_robot_takes_another_way() -> None:
    place = mapped_corridor(ROBUST)
    for delta in connect_by_action(place.graph, 1, 6, "Jump", mu=0.1):
        place.graph.apply(delta)
    elevator = Lift(place, works=False)
    assert go(place, 6, elevator)[0].reached
    assert elevator.begun == 1


class LookAlikeFloors(FlatPredictor):
    """Sees floor 2, ten metres beyond floor 1, as floor 1 but for the beginning of its corridor."""

    def encode(self, observations: Sequence[Observation]) -> Features:
        features = np.array(super().encode(observations), np.float64)
        features[:, 0] -= 10.0 * (features[:, 0] > 11.5)
        return features


def test_after_a_lift_the_robot_knows_on_which_of_two_floors_that_look_alike_it_is() -> None:
    poses = {k: np.array([0.6 + 0.6 * k, 1.0, 0.0]) for k in range(5)}
    poses |= {100 + k: pose + np.array([10.0, 0.0, 0.0]) for k, pose in poses.items()}
    images = [observation_at(pose, k) for k, pose in poses.items()]
    place = map_world(one_room(), images[:1], ROBUST)
    place.predictor = LookAlikeFloors(place.world)
    place.keyframes = KeyframeStore(place.predictor)
    place.keyframes.add(images)
    place.robot.world = FlatWorld(np.concatenate([place.world.walls, place.world.walls + np.array([10.0, 0.0])]))
    place.poses = poses
    for seen in images[1:]:
        place.graph.apply(NodeAdded(node_from_observation(seen), Cause.BUILD))
    for k in (0, 1, 2, 3, 100, 101, 102, 103):
        join_nodes(place, k, k + 1, 0.6)
        join_nodes(place, k + 1, k, -0.6)
    for delta in connect_by_action(place.graph, 4, 104, LIFT):
        place.graph.apply(delta)
    episode, events = go(place, 102, Lift(place))
    assert episode.reached
    taken = next(k for k, event in enumerate(events) if isinstance(event, ActionEnded))
    seen_at = {event.node for event in events_of(Localised, events[taken:])}
    assert seen_at <= {None, 100, 101, 102, 103, 104}


def test_an_action_is_done_where_its_source_is() -> None:
    """The robot goes to the source itself, though it sees places near the target from afar."""
    place = mapped_corridor(ROBUST)
    for key in [(3, 4), (4, 3)]:
        place.graph.apply(EdgePruned(*key, Cause.HAND))
    for delta in connect_by_action(place.graph, 3, 4, "Open the door"):
        place.graph.apply(delta)
    stood: list[float] = []

    class Door(Lift):
        def begin(self, source: NodeId, target: NodeId, action: str) -> None:
            stood.append(float(place.robot.pose[0] - place.poses[source][0]))
            super().begin(source, target, action)

    assert go(place, 6, Door(place))[0].reached
    assert len(stood) == 1
    assert abs(stood[0]) < 0.3
