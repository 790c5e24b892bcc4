"""A rival's network starts from trained weights and learns labels of time, without what poses would tell."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch

from ltvn_core.errors import OptionError
from ltvn_core.network.baseline_training import baseline_hyperparameters, baseline_training_plan, evaluate_baseline
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.training_loop import TrainingData, train
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.training_data.random_walk import WalkRecipe, label_walks
from ltvn_core.network.training_data.shards import Shard
from ltvn_core.network.training_examples import BatchSampler
from ltvn_core.network.weights_file import load_weights, save_weights
from ltvn_core.systems.entry import TemporalLearning
from ltvn_core.systems.registry import system_entry
from ltvn_core.verbs.train import TrainVerb
from tests.core.network.tiny_data import SMALL
from tests.core.network.training_data.box_world import two_rooms


def learning_of(rival: str) -> TemporalLearning:
    found = system_entry(rival).learning
    assert found is not None
    return found


@lru_cache
def walks(name: str, rival: str) -> Shard:
    seen = WalkRecipe(walks=2, images=48).make(two_rooms(name))
    return label_walks(seen, learning_of(rival).rule, np.random.default_rng(0))


@pytest.mark.slow
@pytest.mark.parametrize("rival", ["sptm", "ving"])
def test_training_goes_on_from_trained_weights(tmp_path: Path, rival: str) -> None:
    torch.manual_seed(0)
    start = tmp_path / "start.safetensors"
    save_weights(PairNetwork(SMALL), start)
    plan = replace(baseline_training_plan(even_distances=True, minutes=1.0, steps=2, seed=0), validations=1)
    data = TrainingData([walks("a", rival), walks("b", rival)], [walks("c", rival)])
    result = train(data, plan, tmp_path / "work", start=start)
    old, new = load_weights(start), load_weights(result.weights)
    assert new.size == SMALL
    assert not torch.equal(old.state_dict()["head.sharpness"], new.state_dict()["head.sharpness"])
    mean = "encoder.trunk.0.1.running_mean"
    assert torch.equal(old.state_dict()[mean], new.state_dict()[mean])
    figures = evaluate_baseline(load_predictor(result.weights), data.validation)
    assert figures.pairs == len(data.validation[0].sources)
    assert 0.3 < figures.accuracy <= 1


def test_no_pose_makes_a_pair_far_and_distances_are_learned_as_they_occur() -> None:
    learning = baseline_training_plan(
        even_distances=learning_of("ving").even_distances, minutes=1.0, steps=None, seed=0
    ).learning
    poses = np.array([[0.0, 0.0, 0.0], [900.0, 0.0, np.pi]])
    assert not learning.far.pairs(poses, poses).any()
    assert (learning.hardness, learning.confusions, learning.evened) == (0.0, 0, False)
    assert baseline_hyperparameters(learning, even_distances=True).evened is False
    assert baseline_training_plan(
        even_distances=learning_of("sptm").even_distances, minutes=1.0, steps=None, seed=0
    ).learning.evened


def test_pairs_that_are_not_evened_are_drawn_as_often_as_they_occur() -> None:
    shard = walks("a", "ving")
    within = shard.group[shard.sources] == shard.group[shard.targets]
    share = []
    for evened in (True, False):
        sampler, rng = BatchSampler([shard], evened=evened), np.random.default_rng(0)
        batches = [sampler.draw(rng, groups=1, pairs_per_group=10) for _ in range(150)]
        share.append(np.mean([batch.reachable.mean() for batch in batches]))
    occur = shard.reachable[within].mean()
    assert share[1] == pytest.approx(occur, abs=0.06)
    assert share[0] > share[1] + 0.05


@pytest.mark.parametrize("system", ["sgm", "meng", "brm"])
def test_a_system_whose_network_learns_nothing_of_its_own_is_refused_with_those_that_do(system: str) -> None:
    with pytest.raises(OptionError, match=rf"{system} has no network.*sptm, ving, sorb, htm"):
        TrainVerb(system=system, output=Path("new.safetensors")).run()


@pytest.mark.parametrize("system", ["sorb", "htm"])
def test_layers_that_are_added_to_the_shipped_weights_cannot_learn_from_nothing(system: str) -> None:
    with pytest.raises(OptionError, match=f"{system} adds layers to the shipped weights; leave --fresh out"):
        TrainVerb(system=system, output=Path("new.safetensors"), fresh=True).run()


@pytest.mark.parametrize(
    ("verb", "named"),
    [
        (TrainVerb(output=Path("new.safetensors"), fresh=True), "--fresh"),
        (TrainVerb(output=Path("new.safetensors"), processes=2), "--processes"),
        (TrainVerb(system="sptm", evaluate=True), "--evaluate"),
        (TrainVerb(system="sptm", output=Path("new.safetensors"), architecture="stacked"), "--architecture"),
        (TrainVerb(system="sptm", output=Path("new.safetensors"), bfloat16=True), "--bfloat16"),
    ],
)
def test_options_of_the_one_network_are_refused_with_those_of_the_other(verb: TrainVerb, named: str) -> None:
    with pytest.raises(OptionError, match=named):
        verb.run()
