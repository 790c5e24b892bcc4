"""A recogniser proposes, a poser confirms: what is not proposed costs the poser nothing."""

from collections.abc import Sequence

import numpy as np
import pytest

from ltvn_core.plugins import PREDICTORS, find_plugins
from ltvn_core.predictors.composed import PROPOSED, ComposedPredictor
from ltvn_core.types import Observation
from ltvn_core.verbs.plugins import broken_contract
from tests.core.flat_world import FlatPredictor, FlatRobot, one_room


class RoomHalfRecogniser:
    """Takes all places with x below 3 m for one place, and all others for another."""

    fingerprint = "halves"

    def describe(self, observations: Sequence[Observation]) -> np.ndarray:
        return np.array(
            [[seen.exact_pose is not None and seen.exact_pose[0] < 3.0] for seen in observations], np.float32
        ).reshape(-1, 1)

    def same_place(self, sources: np.ndarray, targets: np.ndarray) -> np.ndarray:
        return np.where(sources[:, 0] == targets[:, 0], 0.9, 0.001)


def images(xs: Sequence[float]) -> list[Observation]:
    return [FlatRobot(one_room(), (x, 2.0, 0.0)).observe() for x in xs]


@pytest.fixture
def poser() -> FlatPredictor:
    return FlatPredictor(one_room())


def test_the_poser_is_asked_about_what_is_proposed_alone(poser: FlatPredictor) -> None:
    composed = ComposedPredictor(RoomHalfRecogniser(), poser)
    features = composed.encode(images([1.0, 1.5, 2.8, 3.2]))

    found = composed.predict(features[:1], features)

    alone = poser.predict(poser.encode(images([1.0])), poser.encode(images([1.0, 1.5, 2.8])))
    assert poser.compared == 3 + 3
    np.testing.assert_array_equal(found.reachability[:3], alone.reachability)
    np.testing.assert_array_equal(found.waypoints[:3], alone.waypoints)
    assert found.reachability[3] == pytest.approx(0.01)


def test_one_image_is_compared_with_the_most_similar_of_many(poser: FlatPredictor) -> None:
    composed = ComposedPredictor(RoomHalfRecogniser(), poser)
    features = composed.encode(images(np.linspace(1.0, 2.0, PROPOSED + 20).tolist()))
    composed.predict(features[:1], features)
    assert poser.compared == PROPOSED


def test_a_composed_predictor_goes_by_both_names_and_the_posers_card(poser: FlatPredictor) -> None:
    composed = ComposedPredictor(RoomHalfRecogniser(), poser)
    assert (composed.fingerprint, composed.camera) == ("halves+flat", poser.camera)
    assert composed.likelihoods is None
    assert len(composed.predict(composed.encode(images([1.0])), composed.encode([])).reachability) == 0


@pytest.mark.slow
def test_photographs_and_geometry_together_keep_the_contract() -> None:
    pytest.importorskip("efficientnet_lite_pytorch", reason="the extra `place` is not installed")
    assert broken_contract(find_plugins(PREDICTORS)["composed"]) == ""
