"""The cause of a failure is told from what happened and where the robot truly was."""

from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from ltvn_core.evaluation.failure_causes import FailureClassifier
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.navigation.events import (
    AttemptEnd,
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    Localised,
    Outcome,
    Planned,
)
from ltvn_core.types import NodeId, Pose
from tests.core.evaluation.ground_truth_map import exact_pose_of, map_with_edges, truth

GOOD, BAD = (2, 3), (5, 6)
"""An edge through the opening, and one through the wall."""
NOWHERE = np.array([1.5, 4.4, 1.6])
"""Where no image was taken."""

Happening = tuple[Event, Pose | None]


class QueryScript:
    """Tells events in order and keeps count of steps."""

    def __init__(self) -> None:
        self.step = 100
        self.collisions = 0
        self.told: list[Happening] = []

    def looks(self, robot: Pose, node: NodeId | None, *, steps: int = 0) -> "QueryScript":
        """The robot at a pose holds itself to be at a node, and does nothing for some steps."""
        self.told.append((Localised(0, self.step, node, 0.5, 0.9, None, np.inf, "local"), robot))
        self.step += steps
        return self

    def finds_no_path(self, steps: int = 10) -> "QueryScript":
        self.told.append((Planned(0, (), np.inf), None))
        self.step += steps
        return self

    def drives(
        self,
        source: NodeId | None,
        target: NodeId,
        steps: int = 50,
        end: AttemptEnd = AttemptEnd.REACHED,
        collisions: int = 0,
    ) -> "QueryScript":
        self.told.append((AttemptStarted(0, 0, source, target, self.step, PoseRow(1.0, 0.0, 0.0), 0.9), None))
        self.step += steps
        for _ in range(collisions):
            self.collisions += 1
            self.told.append((Collided(0, self.collisions), None))
        self.told.append((AttemptEnded(0, 0, source, target, self.step, end, 0.1, 0.9, True, ""), None))
        return self

    def ended(self, outcome: Outcome, *, reached: bool = False) -> tuple[FailureCause | None, FailureClassifier]:
        classifier = FailureClassifier(truth(), map_with_edges((1, 2), GOOD, BAD))
        for event, pose in self.told:
            classifier.consume(event, pose)
        over = QueryResult(query=0, reached=reached, outcome=outcome, steps=self.step - 100, collisions=self.collisions)
        return classifier.failure(over), classifier


def cause(story: QueryScript, outcome: Outcome) -> FailureCause | None:
    return story.ended(outcome)[0]


def good_attempt(story: QueryScript, steps: int = 50, collisions: int = 0) -> QueryScript:
    return story.looks(exact_pose_of(2), 2).drives(*GOOD, steps=steps, collisions=collisions)


def test_an_arrival_is_no_failure_unless_it_is_wrong() -> None:
    assert good_attempt(QueryScript()).ended(Outcome.ARRIVED, reached=True)[0] is None
    assert good_attempt(QueryScript()).ended(Outcome.ARRIVED)[0] is FailureCause.WRONG_ARRIVAL


def test_standing_at_the_goal_without_saying_so_is_a_failure() -> None:
    assert good_attempt(QueryScript()).ended(Outcome.STEP_LIMIT, reached=True)[0] is FailureCause.STEP_LIMIT


def test_no_path_is_the_maps_fault_where_the_robot_knew_its_place() -> None:
    assert cause(QueryScript().looks(exact_pose_of(1), 1).finds_no_path(), Outcome.NO_PATH) is FailureCause.NO_PATH
    assert cause(QueryScript().looks(exact_pose_of(1), 4).finds_no_path(), Outcome.NO_PATH) is FailureCause.MISLOCALISED


def test_a_lost_robot_is_mislocalised_beside_a_node_and_else_off_the_map() -> None:
    assert cause(QueryScript().looks(NOWHERE, None), Outcome.LOST) is FailureCause.NO_PATH
    assert (
        cause(QueryScript().looks(NOWHERE, None).looks(exact_pose_of(2), None), Outcome.LOST)
        is FailureCause.MISLOCALISED
    )


def test_a_robot_that_is_lost_was_led_astray_by_what_went_wrong_before() -> None:
    def lost(story: QueryScript) -> FailureCause | None:
        return cause(story.looks(NOWHERE, None).looks(NOWHERE, None), Outcome.LOST)

    assert lost(QueryScript().looks(NOWHERE, 2).drives(*GOOD)) is FailureCause.MISLOCALISED
    assert lost(QueryScript().looks(exact_pose_of(5), 5).drives(*BAD)) is FailureCause.SPURIOUS_EDGE
    assert (
        lost(QueryScript().looks(exact_pose_of(2), 2).drives(*GOOD, end=AttemptEnd.BLOCKED)) is FailureCause.COLLISION
    )
    assert lost(QueryScript().looks(exact_pose_of(2), 2).drives(*GOOD)) is FailureCause.NO_PATH


def test_steps_spent_on_spurious_edges_are_the_cause_of_running_out() -> None:
    story = good_attempt(QueryScript())
    for _ in range(5):
        story.looks(exact_pose_of(5), 5).drives(*BAD, end=AttemptEnd.BLOCKED)
    assert cause(story, Outcome.STEP_LIMIT) is FailureCause.SPURIOUS_EDGE


def test_a_spurious_edge_left_at_once_costs_what_the_robot_does_until_it_looks_again() -> None:
    story = good_attempt(QueryScript(), steps=10)
    for _ in range(5):
        story.looks(exact_pose_of(5), 5).drives(*BAD, steps=0, end=AttemptEnd.BLOCKED)
        story.step += 12
    assert cause(story.looks(exact_pose_of(5), 5), Outcome.STEP_LIMIT) is FailureCause.SPURIOUS_EDGE


@pytest.mark.parametrize(
    ("robot", "node"),
    [
        pytest.param(exact_pose_of(2), 4, id="far away"),
        pytest.param(exact_pose_of(7), 4, id="turned away"),
        pytest.param(exact_pose_of(6), 5, id="behind a wall"),
    ],
)
def test_attempts_that_start_somewhere_else_are_mislocalised(robot: Pose, node: NodeId) -> None:
    story = QueryScript().looks(robot, node).drives(*GOOD)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert failure is FailureCause.MISLOCALISED
    assert (seen.mislocalised, seen.localised) == (1, 1)


@pytest.mark.parametrize("end", [AttemptEnd.BLOCKED, AttemptEnd.COLLISION])
def test_a_robot_that_jams_on_true_edges_has_a_collision_problem(end: AttemptEnd) -> None:
    story = good_attempt(QueryScript())
    for _ in range(3):
        story.looks(exact_pose_of(2), 2).drives(*GOOD, end=end)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert failure is FailureCause.COLLISION
    assert (seen.localised, seen.mislocalised, seen.trigger) == (4, 0, FailureCause.COLLISION)


def test_a_robot_that_mostly_does_all_right_is_too_slow() -> None:
    story = QueryScript()
    for _ in range(9):
        good_attempt(story)
    story.looks(exact_pose_of(5), 5).drives(*BAD, steps=100)
    assert cause(story, Outcome.STEP_LIMIT) is FailureCause.STEP_LIMIT
    assert cause(QueryScript(), Outcome.STEP_LIMIT) is FailureCause.STEP_LIMIT


def test_looking_around_in_vain_belongs_to_the_attempt_that_led_there() -> None:
    def lost_after(edge: tuple[NodeId, NodeId]) -> QueryScript:
        story = QueryScript().looks(exact_pose_of(edge[0]), edge[0]).drives(*edge, steps=20)
        for _ in range(10):
            story.looks(NOWHERE, None, steps=9)
        return story

    assert cause(lost_after(BAD), Outcome.STEP_LIMIT) is FailureCause.SPURIOUS_EDGE
    assert cause(lost_after(GOOD), Outcome.STEP_LIMIT) is FailureCause.NO_PATH


def test_the_trigger_is_what_went_wrong_first_since_all_was_well() -> None:
    story = QueryScript().looks(exact_pose_of(5), 5).drives(*BAD, steps=10)
    for _ in range(3):
        story.looks(NOWHERE, 2).drives(*GOOD)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert (failure, seen.trigger) == (FailureCause.MISLOCALISED, FailureCause.SPURIOUS_EDGE)
    assert good_attempt(story).ended(Outcome.STEP_LIMIT)[1].trigger is None


def test_too_many_collisions_are_put_down_to_where_they_happened() -> None:
    def story(edge: tuple[NodeId, NodeId]) -> QueryScript:
        few, many = QueryScript(), 15
        return (
            good_attempt(few, steps=500, collisions=6)
            .looks(exact_pose_of(edge[0]), edge[0])
            .drives(*edge, collisions=many)
        )

    assert cause(story(BAD), Outcome.COLLISION_LIMIT) is FailureCause.SPURIOUS_EDGE
    assert cause(story(GOOD), Outcome.COLLISION_LIMIT) is FailureCause.COLLISION


def test_approaching_a_node_is_no_edge() -> None:
    _, seen = QueryScript().looks(exact_pose_of(2), 2).drives(None, 2).ended(Outcome.STEP_LIMIT)
    assert (seen.localised, seen.mislocalised, seen.trigger) == (1, 0, None)


def test_a_story_told_without_poses_believes_the_robot() -> None:
    def without_poses(told: Iterable[Happening]) -> Iterator[Happening]:
        return ((event, None) for event, _ in told)

    story = QueryScript().looks(exact_pose_of(2), 4).drives(*GOOD)
    story.told = list(without_poses(story.told))
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert (failure, seen.mislocalised) == (FailureCause.STEP_LIMIT, 0)
