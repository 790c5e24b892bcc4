"""The cause of a failure is told from what happened and where the robot truly was."""

from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from ltvn_core.evaluate.causes import EpisodeWitness, Sightings
from ltvn_core.evaluate.results import Failure
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.nav.events import (
    Collided,
    Event,
    Judged,
    LegEnd,
    LegEnded,
    LegStarted,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
)
from ltvn_core.types import NodeId, Pose
from tests.core.evaluate.walled import at, mapped, truth

GOOD, BAD = (2, 3), (5, 6)
"""An edge through the opening, and one through the wall."""
NOWHERE = np.array([1.5, 4.4, 1.6])
"""Where no image was taken."""

Happening = tuple[Event, Pose | None]


class Story:
    """Tells events in order and keeps count of steps."""

    def __init__(self) -> None:
        self.step = 100
        self.touches = 0
        self.told: list[Happening] = []

    def looks(self, robot: Pose, node: NodeId | None, *, steps: int = 0) -> "Story":
        """The robot at a pose holds itself to be at a node, and does nothing for some steps."""
        self.told.append((Localised(0, self.step, node, 0.5, 0.9, None, np.inf, "local"), robot))
        self.step += steps
        return self

    def finds_no_path(self, steps: int = 10) -> "Story":
        self.told.append((Planned(0, (), np.inf), None))
        self.step += steps
        return self

    def drives(
        self, source: NodeId | None, target: NodeId, steps: int = 50, end: LegEnd = LegEnd.REACHED, touches: int = 0
    ) -> "Story":
        self.told.append((LegStarted(0, 0, source, target, self.step, PoseRow(1.0, 0.0, 0.0), 0.9), None))
        self.step += steps
        for _ in range(touches):
            self.touches += 1
            self.told.append((Collided(0, self.touches), None))
        self.told.append((LegEnded(0, 0, source, target, self.step, end, 0.1, 0.9, True, ""), None))
        return self

    def ended(self, outcome: Outcome, *, reached: bool = False) -> tuple[Failure | None, Sightings]:
        witness = EpisodeWitness(truth(), mapped((1, 2), GOOD, BAD))
        for event, pose in self.told:
            witness.consume(event, pose)
        over = QueryEnded(0, 4, outcome, self.step - 100, self.touches, 3.0)
        return witness.failure(over, Judged(0, reached, 0.1, 0.1)), witness.sightings


def cause(story: Story, outcome: Outcome) -> Failure | None:
    return story.ended(outcome)[0]


def good_leg(story: Story, steps: int = 50, touches: int = 0) -> Story:
    return story.looks(at(2), 2).drives(*GOOD, steps=steps, touches=touches)


def test_an_arrival_is_no_failure_unless_it_is_wrong() -> None:
    assert good_leg(Story()).ended(Outcome.ARRIVED, reached=True)[0] is None
    assert good_leg(Story()).ended(Outcome.ARRIVED)[0] is Failure.WRONG_ARRIVAL


def test_standing_at_the_goal_without_saying_so_is_a_failure() -> None:
    assert good_leg(Story()).ended(Outcome.STEP_LIMIT, reached=True)[0] is Failure.STEP_LIMIT


def test_no_path_is_the_maps_fault_where_the_robot_knew_its_place() -> None:
    assert cause(Story().looks(at(1), 1).finds_no_path(), Outcome.NO_PATH) is Failure.NO_PATH
    assert cause(Story().looks(at(1), 4).finds_no_path(), Outcome.NO_PATH) is Failure.MISLOCALISED


def test_a_lost_robot_is_mislocalised_beside_a_node_and_else_off_the_map() -> None:
    assert cause(Story().looks(NOWHERE, None), Outcome.LOST) is Failure.NO_PATH
    assert cause(Story().looks(NOWHERE, None).looks(at(2), None), Outcome.LOST) is Failure.MISLOCALISED


def test_a_robot_that_is_lost_was_led_astray_by_what_went_wrong_before() -> None:
    def lost(story: Story) -> Failure | None:
        return cause(story.looks(NOWHERE, None).looks(NOWHERE, None), Outcome.LOST)

    assert lost(Story().looks(NOWHERE, 2).drives(*GOOD)) is Failure.MISLOCALISED
    assert lost(Story().looks(at(5), 5).drives(*BAD)) is Failure.SPURIOUS_EDGE
    assert lost(Story().looks(at(2), 2).drives(*GOOD, end=LegEnd.BLOCKED)) is Failure.COLLISION
    assert lost(Story().looks(at(2), 2).drives(*GOOD)) is Failure.NO_PATH


def test_steps_spent_on_spurious_edges_are_the_cause_of_running_out() -> None:
    story = good_leg(Story())
    for _ in range(5):
        story.looks(at(5), 5).drives(*BAD, end=LegEnd.BLOCKED)
    assert cause(story, Outcome.STEP_LIMIT) is Failure.SPURIOUS_EDGE


def test_a_spurious_edge_left_at_once_costs_what_the_robot_does_until_it_looks_again() -> None:
    story = good_leg(Story(), steps=10)
    for _ in range(5):
        story.looks(at(5), 5).drives(*BAD, steps=0, end=LegEnd.BLOCKED)
        story.step += 12
    assert cause(story.looks(at(5), 5), Outcome.STEP_LIMIT) is Failure.SPURIOUS_EDGE


@pytest.mark.parametrize(
    ("robot", "node"),
    [
        pytest.param(at(2), 4, id="far away"),
        pytest.param(at(7), 4, id="turned away"),
        pytest.param(at(6), 5, id="behind a wall"),
    ],
)
def test_legs_that_start_somewhere_else_are_mislocalised(robot: Pose, node: NodeId) -> None:
    story = Story().looks(robot, node).drives(*GOOD)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert failure is Failure.MISLOCALISED
    assert (seen.astray, seen.spurious_legs, seen.legs) == (1, 0, 1)


@pytest.mark.parametrize("end", [LegEnd.BLOCKED, LegEnd.COLLISION])
def test_a_robot_that_jams_on_true_edges_has_a_collision_problem(end: LegEnd) -> None:
    story = good_leg(Story())
    for _ in range(3):
        story.looks(at(2), 2).drives(*GOOD, end=end)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert failure is Failure.COLLISION
    assert seen == Sightings(legs=4, blocked_legs=3, trigger=Failure.COLLISION)


def test_a_robot_that_mostly_does_all_right_is_too_slow() -> None:
    story = Story()
    for _ in range(9):
        good_leg(story)
    story.looks(at(5), 5).drives(*BAD, steps=100)
    assert cause(story, Outcome.STEP_LIMIT) is Failure.STEP_LIMIT
    assert cause(Story(), Outcome.STEP_LIMIT) is Failure.STEP_LIMIT


def test_looking_around_in_vain_belongs_to_the_leg_that_led_there() -> None:
    def lost_after(leg: tuple[NodeId, NodeId]) -> Story:
        story = Story().looks(at(leg[0]), leg[0]).drives(*leg, steps=20)
        for _ in range(10):
            story.looks(NOWHERE, None, steps=9)
        return story

    assert cause(lost_after(BAD), Outcome.STEP_LIMIT) is Failure.SPURIOUS_EDGE
    assert cause(lost_after(GOOD), Outcome.STEP_LIMIT) is Failure.NO_PATH


def test_the_trigger_is_what_went_wrong_first_since_all_was_well() -> None:
    story = Story().looks(at(5), 5).drives(*BAD, steps=10)
    for _ in range(3):
        story.looks(NOWHERE, 2).drives(*GOOD)
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert (failure, seen.trigger) == (Failure.MISLOCALISED, Failure.SPURIOUS_EDGE)
    assert good_leg(story).ended(Outcome.STEP_LIMIT)[1].trigger is None


def test_too_many_touches_are_put_down_to_where_they_happened() -> None:
    def story(leg: tuple[NodeId, NodeId]) -> Story:
        few, many = Story(), 15
        return good_leg(few, steps=500, touches=6).looks(at(leg[0]), leg[0]).drives(*leg, touches=many)

    assert cause(story(BAD), Outcome.COLLISION_LIMIT) is Failure.SPURIOUS_EDGE
    assert cause(story(GOOD), Outcome.COLLISION_LIMIT) is Failure.COLLISION


def test_approaching_a_node_is_no_edge() -> None:
    _, seen = Story().looks(at(2), 2).drives(None, 2).ended(Outcome.STEP_LIMIT)
    assert seen == Sightings(legs=1)


def test_a_story_told_without_poses_believes_the_robot() -> None:
    def without_poses(told: Iterable[Happening]) -> Iterator[Happening]:
        return ((event, None) for event, _ in told)

    story = Story().looks(at(2), 4).drives(*GOOD)
    story.told = list(without_poses(story.told))
    failure, seen = story.ended(Outcome.STEP_LIMIT)
    assert (failure, seen.astray) == (Failure.STEP_LIMIT, 0)
