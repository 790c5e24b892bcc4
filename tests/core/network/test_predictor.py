"""The predictor answers the same however pairs are batched, and refuses what it cannot read."""

import itertools
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from ltvn_core.errors import ImageError
from ltvn_core.network.architecture import EnsembleArchitecture, PairArchitecture
from ltvn_core.network.image_features import row_length
from ltvn_core.network.network_families import PairNetwork, build_network
from ltvn_core.network.predictor import NetworkPredictor, load_predictor
from ltvn_core.types import Features, HeldFeatures, Observation, Predictor
from tests.core.network.tiny_data import SMALL, tiny_observations


@pytest.fixture(scope="module")
def predictor() -> NetworkPredictor:
    torch.manual_seed(3)
    return NetworkPredictor(PairNetwork(SMALL), "abc")


def test_it_is_a_predictor_with_one_row_of_features_per_image(predictor: NetworkPredictor) -> None:
    usable: Predictor = predictor
    features = usable.encode(tiny_observations(3))
    assert features.shape == (3, row_length(SMALL))
    assert features.dtype == np.float16
    assert usable.encode([]).shape == (0, row_length(SMALL))
    assert usable.fingerprint == "abc"


def test_predictions_are_probabilities_and_waypoints_in_float64(predictor: NetworkPredictor) -> None:
    features = predictor.encode(tiny_observations(6))
    reachability, waypoints = predictor.predict(features[:3], features[3:])
    assert reachability.shape == (3,)
    assert waypoints.shape == (3, 3)
    assert reachability.dtype == waypoints.dtype == np.float64
    assert ((reachability >= 0) & (reachability <= 1)).all()
    assert (np.abs(waypoints[:, 2]) <= np.pi).all()


def test_one_source_meets_all_targets_as_if_repeated(predictor: NetworkPredictor) -> None:
    features = predictor.encode(tiny_observations(8))
    single = predictor.predict(features[:1], features)
    repeated = predictor.predict(np.repeat(features[:1], 8, axis=0), features)
    np.testing.assert_allclose(single.reachability, repeated.reachability, atol=1e-5)
    np.testing.assert_allclose(single.waypoints, repeated.waypoints, atol=1e-4)


def test_batching_changes_neither_features_nor_predictions(predictor: NetworkPredictor) -> None:
    observations = tiny_observations(6)
    together = predictor.encode(observations)
    apart = np.concatenate([predictor.encode([each]) for each in observations])
    np.testing.assert_allclose(together.astype(float), apart.astype(float), atol=4e-3)
    whole = predictor.predict(together, together[::-1])
    parts = [predictor.predict(together[k : k + 1], together[5 - k : 6 - k]) for k in range(6)]
    np.testing.assert_allclose(whole.reachability, np.concatenate([p.reachability for p in parts]), atol=1e-5)


@pytest.mark.parametrize("size", [SMALL, EnsembleArchitecture(**{**asdict(SMALL), "name": "ensemble"})])
def test_answers_are_the_same_to_the_last_bit_before_and_after_the_operations_are_recorded(
    size: PairArchitecture,
) -> None:
    torch.manual_seed(3)
    asked = NetworkPredictor(build_network(size), "")
    features = asked.encode(tiny_observations(9))
    pairs = [(features[:count], features[-count:]) for count in (1, 2, 9)] + [(features[:1], features)]
    first = [asked.predict(*each) for each in pairs]
    for _ in range(30):
        asked.predict(*pairs[1])
    assert asked._compare._recorded is not None
    for pair, before in zip(pairs, first, strict=True):
        after = asked.predict(*pair)
        np.testing.assert_array_equal(after.reachability, before.reachability)
        np.testing.assert_array_equal(after.waypoints, before.waypoints)


def test_the_prefilter_compares_the_best_in_full_and_rates_the_others_below_them() -> None:
    network = PairNetwork(SMALL)
    features = NetworkPredictor(network, "").encode(tiny_observations(40))
    targets = np.tile(features, (6, 1))
    full = NetworkPredictor(network, "", prefilter_from=None).predict(features[:1], targets)
    quick = NetworkPredictor(network, "").predict(features[:1], targets)
    compared = quick.waypoints.any(axis=1)
    assert compared.sum() == 96
    np.testing.assert_allclose(quick.reachability[compared], full.reachability[compared], atol=1e-5)
    assert quick.reachability[~compared].max() <= quick.reachability[compared].min()


def held(predictor: NetworkPredictor, features: Features) -> HeldFeatures:
    """Return features as a map holds them: in another order, with rows between them that mean nothing."""
    keys = predictor.place_keys(features)
    assert keys is not None
    rows = 2 * np.random.default_rng(0).permutation(len(features))
    every, every_key = (np.zeros((2 * len(part), part.shape[1]), part.dtype) for part in (features, keys))
    every[rows], every_key[rows] = features, keys
    return HeldFeatures(every, every_key, rows, np.arange(1, len(every) + 1))


@pytest.mark.parametrize("as_on_card", [False, True])
@pytest.mark.parametrize("count", [30, 240])
def test_of_held_features_it_says_the_same_to_the_last_bit(count: int, as_on_card: bool) -> None:
    predictor = NetworkPredictor(PairNetwork(SMALL), "", as_on_card=as_on_card)
    features = np.tile(predictor.encode(tiny_observations(30)), (8, 1))[:count]
    direct = predictor.predict(features[:1], features)
    among = predictor.predict_among(features[:1], held(predictor, features))
    assert [part.tobytes() for part in among] == [part.tobytes() for part in direct]


def test_an_image_of_another_size_is_refused_with_advice(predictor: NetworkPredictor) -> None:
    observation = tiny_observations(1)[0]
    small = replace(observation, rgb=observation.rgb[::2, ::2], depth=observation.require_depth("the test")[::2, ::2])
    with pytest.raises(ImageError, match="preprocess_observation"):
        predictor.encode([small])


def test_features_of_another_width_or_number_are_refused(predictor: NetworkPredictor) -> None:
    features = predictor.encode(tiny_observations(3))
    with pytest.raises(ValueError, match="must be"):
        predictor.predict(features[:, :-1], features[:, :-1])
    with pytest.raises(ValueError, match="one to one"):
        predictor.predict(features[:2], features)


def test_depth_without_any_return_gives_finite_predictions(predictor: NetworkPredictor) -> None:
    blind = [replace(each, depth=np.zeros_like(each.depth)) for each in tiny_observations(2)]
    features = predictor.encode(blind)
    reachability, waypoints = predictor.predict(features, features)
    assert np.isfinite(reachability).all()
    assert np.isfinite(waypoints).all()


SIZE = (72, 96)


def strange_images() -> list[Observation]:
    """Every combination of strange colours and strange depth."""
    rng = np.random.default_rng(0)
    lone = np.zeros(SIZE, np.float32)
    lone[40, 50] = 1.0
    colours = [np.zeros((*SIZE, 3)), np.full((*SIZE, 3), 255), rng.integers(0, 256, (*SIZE, 3))]
    depths = [np.zeros(SIZE), np.full(SIZE, 0.001), np.full(SIZE, 65.535), lone, rng.random(SIZE) * 1e30]
    pairs = itertools.product(colours, depths)
    return [
        Observation(rgb.astype(np.uint8), depth.astype(np.float32), np.zeros(3), 0.0, step)
        for step, (rgb, depth) in enumerate(pairs)
    ]


def test_any_two_images_are_compared_with_finite_numbers() -> None:
    predictor = load_predictor()
    features = predictor.encode(strange_images())
    assert np.isfinite(features).all()
    for row in range(len(features)):
        found = predictor.predict(features[row : row + 1], features)
        assert np.isfinite(found.waypoints).all()
        assert ((found.reachability >= 0) & (found.reachability <= 1)).all()
