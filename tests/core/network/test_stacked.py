"""The plain network over stacked images is saved and predicts as the aligned one does."""

from pathlib import Path

import numpy as np
import pytest
import torch

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import PairArchitecture, StackedArchitecture
from ltvn_core.network.image_features import pack
from ltvn_core.network.model_card import measure_speed
from ltvn_core.network.network_families import NETWORK_FAMILIES, StackedNetwork, build_network, default_architecture
from ltvn_core.network.optimization.acceleration import MixedPrecision
from ltvn_core.network.optimization.trainer import Hyperparameters, Trainer, restore_checkpoint, save_checkpoint
from ltvn_core.network.predictor import PREFILTER_FROM, NetworkPredictor
from ltvn_core.network.weights_file import load_weights, save_weights
from tests.core.network.tiny_data import SMALL, SMALL_STACKED, tiny_observations

PLAN = Hyperparameters(groups=4, pairs_per_group=10, hard=6, random=4, confusions=1, rate=3e-3)


@pytest.fixture(scope="module")
def predictor() -> NetworkPredictor:
    torch.manual_seed(3)
    return NetworkPredictor(StackedNetwork(SMALL_STACKED), "abc")


def test_weights_come_back_as_the_network_they_were(tmp_path: Path) -> None:
    network = StackedNetwork(SMALL_STACKED)
    save_weights(network, tmp_path / "w.safetensors")
    loaded = load_weights(tmp_path / "w.safetensors")
    assert isinstance(loaded, StackedNetwork)
    assert loaded.size == SMALL_STACKED
    for name, value in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value), name


def test_images_survive_being_kept_as_a_row_of_features() -> None:
    network = StackedNetwork(SMALL_STACKED)
    rgb, depth = torch.randint(0, 256, (2, 3, 72, 96)) / 255, torch.rand(2, 72, 96) * 10
    rows = pack(network.encode(rgb, depth))
    assert rows.shape == (2, network.row_length)
    back = network.unpack(rows)
    assert torch.equal((back.rgb * 255).round(), (rgb * 255).round())
    torch.testing.assert_close(back.depth, depth, rtol=1e-3, atol=1e-3)


def test_one_source_meets_any_number_of_targets_in_full(predictor: NetworkPredictor) -> None:
    features = predictor.encode(tiny_observations(8))
    targets = np.tile(features, (PREFILTER_FROM // 8 + 1, 1))
    single = predictor.predict(features[:1], targets)
    repeated = predictor.predict(np.repeat(features[:1], len(targets), axis=0), targets)
    assert single.reachability.shape == (len(targets),)
    assert single.waypoints.shape == (len(targets), 3)
    assert single.waypoints.any(axis=1).all()
    np.testing.assert_allclose(single.reachability, repeated.reachability, atol=1e-5)
    np.testing.assert_allclose(single.waypoints, repeated.waypoints, atol=1e-4)


def test_it_matters_which_image_is_the_source(predictor: NetworkPredictor) -> None:
    features = predictor.encode(tiny_observations(6))
    there, back = predictor.predict(features[:3], features[3:]), predictor.predict(features[3:], features[:3])
    assert np.abs(there.waypoints - back.waypoints).max() > 1e-4


def test_features_of_the_other_network_are_refused(predictor: NetworkPredictor) -> None:
    features = NetworkPredictor(build_network(SMALL), "other").encode(tiny_observations(2))
    with pytest.raises(ValueError, match="must be"):
        predictor.predict(features, features)


@pytest.mark.parametrize(("saved", "other"), [(SMALL, SMALL_STACKED), (SMALL_STACKED, SMALL)])
def test_a_checkpoint_of_the_other_architecture_is_refused_by_name(
    tmp_path: Path, saved: PairArchitecture | StackedArchitecture, other: PairArchitecture | StackedArchitecture
) -> None:
    path = tmp_path / "c.safetensors"
    save_checkpoint(Trainer(PLAN, saved), path, seconds=0.0)
    with pytest.raises(WeightsError, match=f"architecture '{saved.name}', not '{other.name}'"):
        restore_checkpoint(Trainer(PLAN, other), path)


@pytest.mark.parametrize("family", NETWORK_FAMILIES)
def test_every_family_is_built_by_name_and_measured_alike(family: str) -> None:
    network = build_network(default_architecture(family))
    speed = measure_speed(network, images=4, repeats=1)
    assert network.size.name == family
    assert speed.parameters == sum(each.numel() for each in network.parameters())
    assert speed.encode_ms > 0
    assert speed.pair_ms > 0


def test_an_unknown_family_is_refused_with_those_there_are() -> None:
    with pytest.raises(WeightsError, match=r"'siamese'.*aligned-pairs, stacked"):
        default_architecture("siamese")


def test_half_precision_leaves_outputs_and_the_aligned_matching_in_single() -> None:
    rgb, depth = torch.rand(2, 3, 72, 96), torch.rand(2, 72, 96)
    half = MixedPrecision(bfloat16=True)
    for size in (SMALL, SMALL_STACKED):
        network = build_network(size).eval()
        features = half.encode(network, rgb, depth)
        output = half.compare(network, features, features)
        assert output.logit.dtype == output.pose.dtype == torch.float32
        assert output.matching is None or output.matching.strength.dtype == torch.float32
