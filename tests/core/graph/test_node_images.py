"""Each image is encoded once, and memory is what is held."""

import numpy as np
import pytest

from ltvn_core.errors import MapError
from ltvn_core.graph import keyframes as keyframe_store
from ltvn_core.graph.keyframes import FeatureRows, KeyframeStore
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


@pytest.mark.parametrize("most", [0, 2**20], ids=["in a file", "in memory"])
def test_rows_are_kept_while_more_come_and_others_are_replaced(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keyframe_store, "MOST_IN_MEMORY", most)
    wanted = np.random.default_rng(0).normal(size=(300, 7)).astype(np.float16)
    rows = FeatureRows(wanted[0])
    for place, row in enumerate(wanted):
        rows.put(place, row)
    np.testing.assert_array_equal(rows.array[:300], wanted)
    rows.put(5, wanted[0])
    np.testing.assert_array_equal(rows.array[[5, 6]], wanted[[0, 6]])


def test_rows_of_objects_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keyframe_store, "MOST_IN_MEMORY", 0)
    rows = FeatureRows(np.array(["a"], object))
    for place in range(100):
        rows.put(place, np.array([str(place)], object))
    assert rows.array[99, 0] == "99"
