"""Layers that are added to trained weights learn alone, judge together, and are kept for a few kilobytes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import (
    ContrastiveArchitecture,
    EnsembleArchitecture,
)
from ltvn_core.network.base_network import MixedPrecision
from ltvn_core.network.baseline_training import baseline_training_plan
from ltvn_core.network.image_features import pack
from ltvn_core.network.model_card import measure_speed
from ltvn_core.network.network_families import (
    NETWORK_FAMILIES,
    EnsembleNetwork,
    PairNetwork,
    StackedNetwork,
    build_network,
    default_architecture,
    extend_network,
)
from ltvn_core.network.optimization.training_loop import train
from ltvn_core.network.predictor import PREFILTER_FROM, NetworkPredictor, load_predictor
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.weights_file import load_weights, save_weights
from tests.core.network.tiny_data import SMALL, SMALL_STACKED, tiny_data, tiny_observations


def small(added: EnsembleArchitecture) -> EnsembleNetwork:
    torch.manual_seed(0)
    network = extend_network(PairNetwork(SMALL), added, seed=0)
    assert isinstance(network, EnsembleNetwork)
    return network


def test_the_least_sure_member_counts_and_while_learning_each_has_its_pairs() -> None:
    network = small(EnsembleArchitecture())
    features = network.eval().encode(torch.rand(6, 3, 72, 96), torch.rand(6, 72, 96) * 4)
    with torch.no_grad():
        summary = network.head.summarise(features, features).numbers
        each = torch.cat([member(summary) for member in network.members], dim=1)
        assert torch.equal(network.compare(features, features).logit, each.min(dim=1).values)
        network.train()
        learning = network.compare(features, features).logit
    assert torch.equal(learning, each[range(6), [0, 1, 2, 0, 1, 2]])


@pytest.mark.parametrize("added", [EnsembleArchitecture(), ContrastiveArchitecture()], ids=lambda added: added.name)
def test_only_the_added_layers_learn(tmp_path: Path, added: EnsembleArchitecture) -> None:
    start = tmp_path / "start.safetensors"
    save_weights(small(added), start)
    plan = replace(
        baseline_training_plan(even_distances=False, minutes=1.0, steps=2, seed=0, fresh=True),
        validations=1,
        validation_pairs=50,
        validation_far=50,
    )
    result = train(tiny_data(), plan, tmp_path / "work", start=start)
    old, new = load_weights(start).state_dict(), load_weights(result.weights).state_dict()
    changed = {name.split(".")[0] for name, value in new.items() if not torch.equal(value, old[name])}
    assert changed == {"members", "calibration"}


def test_only_the_added_layers_are_written_and_poses_are_those_of_the_weights_below(tmp_path: Path) -> None:
    path = tmp_path / "added.safetensors"
    save_weights(
        extend_network(load_weights(SHIPPED_WEIGHTS), EnsembleArchitecture(), seed=3), path, added_to=SHIPPED_WEIGHTS
    )
    assert path.stat().st_size < 100_000
    ours, theirs = load_predictor(SHIPPED_WEIGHTS), load_predictor(path)
    seen = tiny_observations(4)
    features = ours.encode(seen)
    assert np.array_equal(theirs.encode(seen), features)
    assert np.allclose(theirs.predict(features[:1], features).waypoints, ours.predict(features[:1], features).waypoints)
    again = tmp_path / "again.safetensors"
    assert save_weights(load_weights(path), again, added_to=SHIPPED_WEIGHTS) == load_predictor(path).fingerprint


def test_layers_that_were_added_to_other_weights_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "added.safetensors"
    network = extend_network(load_weights(SHIPPED_WEIGHTS), EnsembleArchitecture(), seed=3)
    fingerprint = load_predictor().fingerprint
    save_weights(network, path, added_to=SHIPPED_WEIGHTS)
    path.write_bytes(path.read_bytes().replace(fingerprint.encode(), b"0123456789ab"))
    with pytest.raises(WeightsError, match=r"added\.safetensors: adds layers to the weights 0123456789ab"):
        load_weights(path)
    text = json.dumps(json.dumps({"name": "ltvn", "fingerprint": "0123456789ab"}))[1:-1].encode()
    path.write_bytes(path.read_bytes().replace(text, b"7".ljust(len(text))))
    with pytest.raises(WeightsError, match="adds layers to the weights None"):
        load_weights(path)


def test_new_layers_are_drawn_with_their_seed() -> None:
    one, other = (build_network(EnsembleArchitecture()) for _ in range(2))
    below = PairNetwork(SMALL)
    drawn = [extend_network(below, EnsembleArchitecture(), seed) for seed in (1, 1, 2)]
    weights = [network.state_dict()["members.0.0.weight"] for network in drawn]
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])
    assert not torch.equal(one.state_dict()["members.0.0.weight"], other.state_dict()["members.1.0.weight"])


@pytest.fixture(scope="module")
def predictor() -> NetworkPredictor:
    torch.manual_seed(3)
    return NetworkPredictor(StackedNetwork(SMALL_STACKED), "abc")


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


@pytest.mark.parametrize("family", NETWORK_FAMILIES)
def test_every_family_is_built_by_name_and_measured_alike(family: str) -> None:
    network = build_network(default_architecture(family))
    speed = measure_speed(network, images=4, repeats=1)
    assert network.size.name == family
    assert speed.parameters == sum(each.numel() for each in network.parameters())
    assert speed.encode_ms > 0
    assert speed.pair_ms > 0


def test_half_precision_leaves_outputs_and_the_aligned_matching_in_single() -> None:
    rgb, depth = torch.rand(2, 3, 72, 96), torch.rand(2, 72, 96)
    half = MixedPrecision(bfloat16=True)
    for size in (SMALL, SMALL_STACKED):
        network = build_network(size).eval()
        features = half.encode(network, rgb, depth)
        output = half.compare(network, features, features)
        assert output.logit.dtype == output.pose.dtype == torch.float32
        assert output.matching is None or output.matching.strength.dtype == torch.float32
