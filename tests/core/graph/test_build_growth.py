"""A map of a drive four times as long asks about four times as many pairs, also where it falls into many pieces."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.geometry import relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import Features, Observation, Pose, Prediction
from tests.core.flat_world import FlatPredictor, one_room

METHOD = replace(ROBUST, building=replace(ROBUST.building, floor_edges=False))
ROOM_M, CORRIDOR_M = 2.0, 13.0
STEP_M, TURN_RAD = 0.25, np.pi / 6
PICTURE = np.zeros((72, 96, 3), np.uint8)
MOST_GROWTH = 1.3
FEW_ROOMS, TIMES = 4, 4
"""472 and 1,888 images; with `FEW_ROOMS` 9 it holds, too, and takes a minute."""


class DarkCorridors(FlatPredictor):
    """Recognises images of one room that were taken near each other, and none of a corridor."""

    def predict(self, sources: Features, targets: Features) -> Prediction:
        first, second = np.broadcast_arrays(sources[:, :3], targets[:, :3])
        self.compared += len(first)
        waypoints = relative(first, second)
        dark = np.maximum(first[:, 0], second[:, 0]) % (ROOM_M + CORRIDOR_M) > ROOM_M + STEP_M / 2
        seen = (np.hypot(waypoints[:, 0], waypoints[:, 1]) < 2 * STEP_M) & (np.abs(waypoints[:, 2]) < TURN_RAD) & ~dark
        return Prediction(np.where(seen, 0.95, 0.05), waypoints)


def poses_round_rooms(count: int) -> Iterator[Pose]:
    """Yield the poses of a drive twice round each of some rooms in a row."""
    for number in range(count):
        pose = np.array([number * (ROOM_M + CORRIDOR_M), 0.0, 0.0])
        for _ in range(8):
            for _ in range(round(ROOM_M / STEP_M)):
                yield pose.copy()
                pose[:2] += STEP_M * np.array([np.cos(pose[2]), np.sin(pose[2])])
            for _ in range(3):
                yield pose.copy()
                pose[2] += TURN_RAD
        for away_m in np.arange(0.0, ROOM_M + CORRIDOR_M, 2 * STEP_M):
            yield np.add(pose, [away_m, 0.0, 0.0])


def drive_past(rooms: int) -> list[Observation]:
    poses = enumerate(poses_round_rooms(rooms))
    return [Observation(PICTURE, None, pose, step / 10, step, pose) for step, pose in poses]


def asked_for_map_of(rooms: int) -> tuple[int, int]:
    """Return the number of images of a drive, and of the pairs of them that building compares."""
    images = drive_past(rooms)
    predictor = DarkCorridors(one_room())
    build(images, KeyframeStore(predictor), predictor, METHOD, np.random.default_rng(0))
    return len(images), predictor.compared


@pytest.mark.slow
def test_a_drive_through_four_times_as_many_rooms_asks_about_four_times_as_many_pairs() -> None:
    few_images, few = asked_for_map_of(FEW_ROOMS)
    images, many = asked_for_map_of(FEW_ROOMS * TIMES)
    assert few_images > 400
    assert images == TIMES * few_images
    assert many < MOST_GROWTH * TIMES * few
