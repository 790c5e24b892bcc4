"""Fine-tuning changes weights for a place, keeps the old ones, and goes on after an interruption."""

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import torch

from ltvn_core.errors import WeightsError
from ltvn_core.network.network_families import PairNetwork
from ltvn_core.network.optimization.fine_tuning_loop import (
    FineTuningData,
    FineTuningPlan,
    FineTuningProgress,
    run_fine_tuning,
)
from ltvn_core.network.optimization.reachability_calibration import calibrate_after_fine_tuning
from ltvn_core.network.optimization.trainer import Hyperparameters
from ltvn_core.network.training_data.trajectory import select_keyframes
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule, TrajectoryPairs, label_trajectory
from ltvn_core.network.training_examples import FarCriterion, MixedBatchSampler
from ltvn_core.network.weights_file import load_weights, save_weights, weights_fingerprint
from tests.core.network.tiny_data import SMALL, tiny_drive, tiny_shard
from tests.core.network.training_data.example_drive import observations_at, poses_along

PLAN = FineTuningPlan(
    Hyperparameters(groups=4, confusions=1, hard=6, random=4, rate=1e-3), minutes=None, steps=3, minings=2
)
PLAN = replace(PLAN, validation_pairs=60, validation_far=60)


@lru_cache
def own_drive() -> TrajectoryPairs:
    poses = poses_along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3), (6.5, 3.3), (6.5, 1.0))
    return label_trajectory(
        select_keyframes(observations_at(poses), "drive.rrd"), OdometryLabelRule(horizon=6), np.random.default_rng(0)
    )


def data() -> FineTuningData:
    return FineTuningData(own_drive(), [tiny_shard()], [tiny_shard("b")], [tiny_drive()])


@pytest.fixture
def start(tmp_path: Path) -> Path:
    torch.manual_seed(0)
    save_weights(PairNetwork(SMALL), tmp_path / "start.safetensors")
    return tmp_path / "start.safetensors"


@pytest.mark.slow
def test_a_short_run_changes_the_weights_and_not_the_parent(tmp_path: Path, start: Path) -> None:
    before, told = start.read_bytes(), list[FineTuningProgress]()
    result = run_fine_tuning(data(), start, PLAN, tmp_path / "work", on_progress=told.append)
    assert start.read_bytes() == before
    assert (result.parent, result.steps) == (weights_fingerprint(start), 3)
    old, new = load_weights(start).state_dict(), result.network.state_dict()
    assert not torch.equal(old["head.sharpness"], new["head.sharpness"])
    assert torch.equal(old["encoder.trunk.0.1.running_mean"], new["encoder.trunk.0.1.running_mean"])
    assert told[-1].share == 1.0
    assert "learning" in {each.doing for each in told}
    assert result.before is not None
    assert result.after is not None
    assert result.before.own.pairs.pairs == result.after.own.pairs.pairs > 100
    assert result.before.simulated_drives is not None


def test_a_cancelled_run_goes_on_where_it_was(tmp_path: Path, start: Path) -> None:
    told = list[FineTuningProgress]()

    def stop(progress: FineTuningProgress) -> None:
        if progress.steps == 2:
            raise InterruptedError

    plan = replace(PLAN, minings=0)
    with pytest.raises(InterruptedError):
        run_fine_tuning(data(), start, plan, tmp_path / "work", on_progress=stop)
    result = run_fine_tuning(data(), start, plan, tmp_path / "work", on_progress=told.append)
    assert (told[0].steps, result.steps) == (2, 3)


def test_an_unfinished_run_of_other_weights_is_not_gone_on_with(tmp_path: Path, start: Path) -> None:
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "run.json").write_text(json.dumps({"parent": "another", "drive": "x"}), encoding="utf-8")
    with pytest.raises(WeightsError, match="unfinished fine-tuning of weights another on x"):
        run_fine_tuning(data(), start, PLAN, tmp_path / "work")


def test_half_a_batch_is_the_drive_and_none_of_it_is_held_out() -> None:
    drive, sampler = own_drive(), MixedBatchSampler(own_drive(), [tiny_shard()], FarCriterion())
    batch = sampler.draw(np.random.default_rng(0), groups=8, pairs_per_group=6)
    own = np.flatnonzero(batch.scene >= sampler.drive_number)
    assert 0.25 < len(own) / len(batch.scene) < 0.75
    kept_back = {image.tobytes() for image in drive.rgb[drive.held_out]}
    assert kept_back
    assert not kept_back & {image.tobytes() for image in drive.rgb[batch.images[-1][1]]}
    assert batch.reachable[np.isin(batch.sources, own)].any()


def test_images_of_the_drive_are_apart_from_simulated_ones_and_unsure_of_their_own() -> None:
    sampler = MixedBatchSampler(own_drive(), [tiny_shard()], FarCriterion())
    batch = sampler.draw(np.random.default_rng(1), groups=8, pairs_per_group=6)
    own = batch.scene >= sampler.drive_number
    assert batch.apart is not None
    assert batch.apart[np.ix_(own, ~own)].all()
    assert not batch.apart[np.ix_(own, own)].all()
    assert not batch.apart[batch.sources[batch.reachable], batch.targets[batch.reachable]].any()


def test_a_drive_too_short_to_hold_anything_back_is_calibrated_by_simulation() -> None:
    short, network = replace(own_drive(), rule=OdometryLabelRule(horizon=60)), PairNetwork(SMALL)
    assert not short.held_out.any()
    before = network.calibration.clone()
    calibrate_after_fine_tuning(network, short, [])
    assert torch.equal(network.calibration, before)
    calibrate_after_fine_tuning(network, short, [tiny_shard("b")])
    assert not torch.equal(network.calibration, before)
