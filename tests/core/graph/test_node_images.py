"""Each image is encoded once, and memory is what is held."""

import numpy as np
import pytest

from ltvn_core.errors import MapError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, observation_at, one_room


def row(count: int, spacing_m: float = 0.1) -> list[Observation]:
    return [observation_at(np.array([spacing_m * k, 0.0, 0.0]), 10 * k) for k in range(count)]


def test_an_image_offered_twice_is_encoded_once() -> None:
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    keyframes.add(row(5))
    keyframes.add(row(8))
    assert predictor.encoded == 8
    assert len(keyframes) == 8


def test_features_come_back_in_the_order_asked_for() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.add(row(200))
    assert keyframes.features([30, 10, 1990])[:, 3].tolist() == [30, 10, 1990]
    assert keyframes.observation(30).step == 30


def test_dropped_rows_are_used_again() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.add(row(64))
    for k in range(64, 1000):
        keyframes.drop([10 * (k - 64)])
        keyframes.add([observation_at(np.zeros(3), 10 * k)])
    assert len(keyframes) == 64
    assert keyframes._features is not None
    assert len(keyframes._features.array) == 64
    assert keyframes.frames == tuple(range(9360, 10_000, 10))
    assert keyframes.features([9990])[0, 3] == 9990


def test_an_image_that_is_not_held_is_an_error_that_names_it() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    with pytest.raises(MapError, match="frame 7"):
        keyframes.observation(7)
    with pytest.raises(MapError, match="7"):
        keyframes.features([7])


def test_neighbours_in_time_are_near_by_odometry_too() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.add([*row(3), observation_at(np.array([9.0, 0.0, 0.0]), 30)])
    assert keyframes.temporal_neighbours(10, 0.8) == (0, 20)
    assert keyframes.temporal_neighbours(20, 0.8) == (10,)
    assert keyframes.temporal_neighbours(30, 0.8) == ()


def test_keeping_some_forgets_the_others() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.add(row(5))
    keyframes.keep_only([10, 40])
    assert keyframes.frames == (10, 40)
    assert 0 not in keyframes
