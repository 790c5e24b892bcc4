"""Each image is encoded once, and memory is what is held."""

import numpy as np
import pytest

from ltvn_core.errors import MapError
from ltvn_core.graph.views import Views
from ltvn_core.types import Observation
from tests.core.world import FlatPredictor, look_at, one_room


def row(count: int, spacing_m: float = 0.1) -> list[Observation]:
    return [look_at(np.array([spacing_m * k, 0.0, 0.0]), 10 * k) for k in range(count)]


def test_an_image_offered_twice_is_encoded_once() -> None:
    predictor = FlatPredictor(one_room())
    views = Views(predictor)
    views.add(row(5))
    views.add(row(8))
    assert predictor.encoded == 8
    assert len(views) == 8


def test_features_come_back_in_the_order_asked_for() -> None:
    views = Views(FlatPredictor(one_room()))
    views.add(row(200))
    assert views.features([30, 10, 1990])[:, 3].tolist() == [30, 10, 1990]
    assert views.observation(30).step == 30


def test_dropped_rows_are_used_again() -> None:
    views = Views(FlatPredictor(one_room()))
    views.add(row(64))
    for k in range(64, 1000):
        views.drop([10 * (k - 64)])
        views.add([look_at(np.zeros(3), 10 * k)])
    assert len(views) == 64
    assert views._features is not None
    assert len(views._features) == 64
    assert views.frames == tuple(range(9360, 10_000, 10))
    assert views.features([9990])[0, 3] == 9990


def test_an_image_that_is_not_held_is_an_error_that_names_it() -> None:
    views = Views(FlatPredictor(one_room()))
    with pytest.raises(MapError, match="frame 7"):
        views.observation(7)
    with pytest.raises(MapError, match="7"):
        views.features([7])


def test_neighbours_in_time_are_near_by_odometry_too() -> None:
    views = Views(FlatPredictor(one_room()))
    views.add([*row(3), look_at(np.array([9.0, 0.0, 0.0]), 30)])
    assert views.neighbours(10, 0.8) == (0, 20)
    assert views.neighbours(20, 0.8) == (10,)
    assert views.neighbours(30, 0.8) == ()


def test_keeping_some_forgets_the_others() -> None:
    views = Views(FlatPredictor(one_room()))
    views.add(row(5))
    views.keep_only([10, 40])
    assert views.frames == (10, 40)
    assert 0 not in views
