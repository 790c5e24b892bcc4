"""The robot says that it has arrived only where images show it, and its event names what decided."""

from collections.abc import Callable
from operator import attrgetter

import numpy as np
import pytest

from ltvn_core.analysis.decisions import query_decisions
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.geometry import wrap_angle
from ltvn_core.navigation.arrival import is_at_goal
from ltvn_core.navigation.events import BY_IMAGE, BY_PLACE, AttemptStarted, Event, Outcome, QueryEnded, StampedEvent
from ltvn_core.navigation.learning import judge_attempt
from ltvn_core.types import Features, NodeId, Prediction
from tests.core.flat_world import FlatPredictor, one_room, tour
from tests.core.navigation.mapped_world import FIRST_STEP, MappedWorld, map_world, mapped_rooms


class Changed(FlatPredictor):
    """Answers otherwise than the map's predictor for some pairs of images."""

    change: Callable[[Prediction, np.ndarray, np.ndarray], None]

    def predict(self, sources: Features, targets: Features) -> Prediction:
        sources, targets = (np.asarray(each, np.float64) for each in np.broadcast_arrays(sources, targets))
        answer = super().predict(sources, targets)
        self.change(answer, sources, targets)
        return answer


def mapped_rooms_with(hides: Callable[[MappedWorld, Features, Features], np.ndarray]) -> MappedWorld:
    """Return two mapped rooms in which the robot recognises less, as if something stood in front of the camera."""

    def change(answer: Prediction, sources: np.ndarray, targets: np.ndarray) -> None:
        answer.reachability[hides(place, sources, targets)] = 0.01

    place = mapped_rooms(ROBUST)
    place.predictor = Changed(place.world)
    place.predictor.change = change
    return place


def is_live(features: Features) -> np.ndarray:
    """Tell (N,) which features are of images taken in the query."""
    return np.asarray(features, np.float64)[:, 3] >= FIRST_STEP


def end_of(events: list[Event]) -> QueryEnded:
    (ended,) = [event for event in events if isinstance(event, QueryEnded)]
    return ended


def rules_at_the_end(events: list[Event]) -> list[tuple[str, float | None]]:
    timeline = Timeline.of([StampedEvent(k, 0.1 * k, event) for k, event in enumerate(events)])
    return [(used.rule, used.found) for used in query_decisions(timeline, 0, ROBUST)[-1].rules]


def goal_of(place: MappedWorld) -> NodeId:
    return place.nearest(5.0, 3.0)


def test_an_arrival_that_the_image_shows_names_the_rule_and_its_numbers() -> None:
    place = mapped_rooms(ROBUST)
    episode, events = place.go(goal_of(place))

    ended = end_of(events)
    assert episode.reached
    assert ended.rule == BY_IMAGE
    assert rules_at_the_end(events) == [("judging.arrive_distance", ended.distance), (BY_IMAGE, ended.reachability)]


def test_a_goal_whose_image_shows_something_else_now_is_reached_by_the_images_around() -> None:
    def hides(place: MappedWorld, sources: Features, targets: Features) -> np.ndarray:
        goal = goal_of(place)
        return (is_live(sources) & (targets[:, 3] == goal)) | (is_live(targets) & (sources[:, 3] == goal))

    place = mapped_rooms_with(hides)
    episode, events = place.go(goal_of(place))

    ended = end_of(events)
    assert episode.reached
    assert (ended.rule, ended.reachability) == (BY_PLACE, 0.01)
    assert rules_at_the_end(events) == [(BY_PLACE, None)], "r was not what decided"


def test_a_robot_that_is_sure_of_its_place_arrives_though_the_goal_never_seems_near() -> None:
    def change(answer: Prediction, sources: np.ndarray, targets: np.ndarray) -> None:
        is_goal = is_live(sources) & (targets[:, 3] == goal_of(place))
        ahead = answer.waypoints[is_goal, 0]
        answer.waypoints[is_goal, 0] = np.copysign(np.maximum(np.abs(ahead), 0.6), ahead)

    place = mapped_rooms(ROBUST)
    place.predictor = Changed(place.world)
    place.predictor.change = change
    episode, events = place.go(goal_of(place))

    assert episode.reached
    assert end_of(events).rule == BY_PLACE
    attempts = [event for event in events if isinstance(event, AttemptStarted)]
    assert sum(attempt.target == goal_of(place) for attempt in attempts) < 3


@pytest.mark.parametrize("near_m", [0.9, 2.0])
def test_a_robot_that_recognises_nothing_near_its_goal_does_not_say_that_it_has_arrived(near_m: float) -> None:
    def hides(place: MappedWorld, sources: Features, targets: Features) -> np.ndarray:
        there = place.poses[goal_of(place)][:2]
        near = [np.hypot(*(np.asarray(each, np.float64)[:, :2] - there).T) < near_m for each in (sources, targets)]
        return (is_live(sources) | is_live(targets)) & (near[0] | near[1])

    place = mapped_rooms_with(hides)
    _, events = place.go(goal_of(place))

    assert end_of(events).outcome is not Outcome.ARRIVED
    assert end_of(events).rule == ""


def test_beside_a_goal_in_front_of_a_bare_wall_the_images_in_other_directions_decide() -> None:
    def change(answer: Prediction, sources: np.ndarray, targets: np.ndarray) -> None:
        """Make all images that face +y look as if taken at one place."""
        faces = [np.abs(wrap_angle(each[:, 2] - np.pi / 2)) < 0.3 for each in (sources, targets)]
        bare = faces[0] & faces[1] & (np.hypot(*(sources - targets)[:, :2].T) < FlatPredictor.sight_m)
        answer.reachability[bare] = 0.95
        answer.waypoints[bare, 1] = 0.0

    predictor = Changed(one_room())
    predictor.change = change
    images = list(tour([(0.8, 2.0), (1.6, 2.0), (2.4, 2.0), (3.2, 2.0), (4.0, 2.0)]))
    place = map_world(one_room(), images, ROBUST, predictor=predictor)
    facing_wall = [node for node in place.graph.nodes if abs(wrap_angle(place.poses[node][2] - np.pi / 2)) < 0.15]
    goal = min(facing_wall, key=lambda node: abs(place.poses[node][0] - 3.2))
    place.robot.put_down([place.poses[goal][0] - 0.8, 2.0, np.pi / 2], [0.0, 0.0, 0.0])

    episode, events = place.go(goal)

    assert episode.reached
    assert end_of(events).rule == BY_PLACE


THERE = np.array([0.1, 0.0, 0.0])


def verdict(
    method: Method = ROBUST, r: float = 0.9, d: float = 0.2, left: np.ndarray = THERE, **also: bool
) -> tuple[bool, str]:
    judged = judge_attempt(r, d, left, method, **also)
    assert attrgetter(judged.rule)(method) is not None
    return judged.succeeded, judged.reason


def test_every_failure_names_its_rule() -> None:
    assert verdict()[0]
    assert verdict(r=0.2) == (False, "target does not look reachable: r = 0.20, needs 0.50")
    assert verdict(d=0.9) == (False, "target is still too far: d = 0.90, needs 0.70")
    assert verdict(driven_too_often=True) == (False, "driven too often in this query")
    assert verdict(fits_place=False) == (False, "the images of the whole query say that the target is elsewhere")


def test_what_stands_in_the_way_or_goes_in_circles_says_little_about_the_edge() -> None:
    assert judge_attempt(0.2, 0.9, THERE, ROBUST, hindered=True).hindered
    assert judge_attempt(0.9, 0.2, THERE, ROBUST, driven_too_often=True).hindered
    assert not judge_attempt(0.9, 0.2, THERE, ROBUST, fits_place=False, hindered=True).hindered
    assert not judge_attempt(0.2, 0.9, THERE, ROBUST).hindered


def test_a_target_that_is_where_odometry_says_but_hard_to_recognise_says_little_about_the_edge() -> None:
    judged = judge_attempt(0.4, 0.1, THERE, ROBUST)
    assert (judged.succeeded, judged.hindered) == (False, True)
    assert not judge_attempt(0.4, 0.1, np.array([0.5, 0.0, 0.0]), ROBUST).hindered


def test_the_literal_method_asks_whether_the_target_is_connectable() -> None:
    assert verdict(PAPER, d=1.4).__getitem__(0)
    assert not verdict(PAPER, d=1.6)[0]
    assert not verdict(PAPER, r=0.7)[0]
    assert verdict(PAPER, left=np.array([2.0, 0, 0]))[0]


def test_the_goal_is_reached_near_reachable_and_facing_the_right_way() -> None:
    assert is_at_goal(0.9, np.array([0.2, 0.0, 0.1]), ROBUST.judging)
    assert not is_at_goal(0.5, np.array([0.2, 0.0, 0.1]), ROBUST.judging)
    assert not is_at_goal(0.9, np.array([0.6, 0.0, 0.0]), ROBUST.judging)
    assert not is_at_goal(0.9, np.array([0.0, 0.0, 0.33]), ROBUST.judging)
    assert is_at_goal(0.9, np.array([0.0, 0.0, 0.28]), PAPER.judging)
