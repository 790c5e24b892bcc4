"""The oracle of rooms names the room that an image was taken in."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from ltvn_core.evaluation.true_rooms import true_rooms
from ltvn_core.simulation.scene_registry import load_scene
from tests.core.flat_world import observation_at


def test_each_image_lies_in_the_room_that_it_was_taken_in() -> None:
    scene = load_scene("demo")
    centres = [((room.x0 + room.x1) / 2, (room.y0 + room.y1) / 2) for room in scene.rooms]
    seen = [observation_at(np.array([*xy, 0.5]), k) for k, xy in enumerate([*centres, (-50.0, 0.0)])]
    room_of = true_rooms(scene, lambda frame: seen[frame])
    assert [room_of(k) for k in range(len(seen))] == [*range(len(scene.rooms)), None]
