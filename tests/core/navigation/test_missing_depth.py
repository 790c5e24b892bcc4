"""An image without depth ends nothing: it is kept, used by nothing that needs depth, and said once."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.navigation.events import AttemptEnded, GraphChanged, Note, Outcome
from tests.core.flat_world import FlatPredictor
from tests.core.navigation.blind_world import NO_DEPTH, blind_robot
from tests.core.navigation.mapped_world import events_of, mapped_corridor, mapped_rooms

DEPTHS = pytest.mark.parametrize("depth", NO_DEPTH.values(), ids=NO_DEPTH.keys())
CASES = pytest.mark.parametrize(("method", "depth"), [(ROBUST, NO_DEPTH["zero"]), (PAPER, NO_DEPTH["absent"])])


@CASES
def test_the_robot_arrives_though_every_third_image_has_no_depth(method: Method, depth: np.ndarray | None) -> None:
    place = blind_robot(mapped_rooms(method), depth, lambda pose, step: step % 3 == 0)

    episode, events = place.go(place.nearest(5.2, 0.8))

    assert episode.outcome == Outcome.ARRIVED
    assert episode.reached
    assert any("has no depth" in note.text for note in events_of(Note, events))


@CASES
def test_a_robot_that_never_has_depth_gives_up_as_lost(method: Method, depth: np.ndarray | None) -> None:
    place = blind_robot(mapped_rooms(method), depth, lambda pose, step: True)

    episode, events = place.go(place.nearest(5.2, 0.8))

    assert episode.outcome in (Outcome.LOST, Outcome.STEP_LIMIT)
    assert len([note for note in events_of(Note, events) if "has no depth" in note.text]) == 1
    assert not events_of(GraphChanged, events)


@DEPTHS
def test_the_map_learns_nothing_from_an_attempt_that_ended_without_depth(depth: np.ndarray | None) -> None:
    place = blind_robot(mapped_corridor(PAPER), depth, lambda pose, step: 1.1 < pose[0] < 1.9)
    before = {key: edge.belief for key, edge in place.graph.edges.items()}

    _, events = place.go(1)

    ended = [end for end in events_of(AttemptEnded, events) if end.source is not None]
    blind = [end for end in ended if "no depth" in end.reason]
    assert blind
    assert not any(end.succeeded for end in blind)
    if len(blind) == len(ended):
        assert {key: edge.belief for key, edge in place.graph.edges.items()} == before


def test_a_note_is_repeated_only_after_depth_came_back() -> None:
    place = blind_robot(mapped_rooms(ROBUST), None, lambda pose, step: step % 40 < 20)

    _, events = place.go(place.nearest(5.2, 0.8))

    notes = [note for note in events_of(Note, events) if "has no depth" in note.text]
    assert 0 < len(notes) <= 2 + place.robot.step // 20


def test_depth_that_a_predictor_does_not_need_is_not_missed() -> None:
    place = blind_robot(mapped_rooms(ROBUST), None, lambda pose, step: True)
    colour_only = replace(place, predictor=FlatPredictor(place.world))

    episode, events = colour_only.go(place.nearest(5.2, 0.8))

    assert episode.outcome == Outcome.ARRIVED
    assert not [note for note in events_of(Note, events) if "has no depth" in note.text]
