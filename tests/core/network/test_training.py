"""Both networks: training lowers the loss, goes on after an interruption as if nothing had happened, keeps the best."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ltvn_core.errors import WeightsError
from ltvn_core.geometry import relative
from ltvn_core.network.architecture import PairArchitecture, StackedArchitecture
from ltvn_core.network.base_network import FLOAT32
from ltvn_core.network.optimization.hard_negative_mining import mine_hard_negatives
from ltvn_core.network.optimization.reachability_calibration import fit_platt
from ltvn_core.network.optimization.trainer import (
    Hyperparameters,
    Trainer,
    learning_rate_schedule,
    restore_checkpoint,
    save_checkpoint,
)
from ltvn_core.network.optimization.training_loop import TensorBoardLog, TrainingPlan, Validation, train
from ltvn_core.network.pair_evaluation import evaluate_all_pairs, evaluate_drives
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.training_examples import BatchSampler, FarCriterion, HardNegative
from tests.core.network.tiny_data import SMALL, SMALL_STACKED, tiny_data, tiny_drive, tiny_shard

PLAN = Hyperparameters(groups=4, pairs_per_group=10, hard=6, random=4, confusions=1, rate=3e-3)
both_networks = pytest.mark.parametrize("size", [SMALL, SMALL_STACKED], ids=lambda size: size.name)


def trainer(size: PairArchitecture | StackedArchitecture = SMALL) -> Trainer:
    return Trainer(PLAN, size)


@pytest.mark.slow
@both_networks
def test_a_few_steps_lower_the_loss(size: PairArchitecture | StackedArchitecture) -> None:
    sampler, learning = BatchSampler([tiny_shard()]), trainer(size)
    reports = [learning.step(sampler, 0.1 + step / 100) for step in range(40)]
    assert isinstance(size, PairArchitecture) or all(report.total == report.loss for report in reports)
    losses = [report.total for report in reports]
    assert np.mean(losses[-5:]) < 0.85 * np.mean(losses[:5])


@both_networks
def test_a_resumed_training_equals_an_uninterrupted_one(
    tmp_path: Path, size: PairArchitecture | StackedArchitecture
) -> None:
    sampler, straight = BatchSampler([tiny_shard()]), trainer(size)
    straight.confusions = [HardNegative(0, 0, 20)]
    for step in range(4):
        if step == 2:
            save_checkpoint(straight, tmp_path / "c.safetensors", seconds=1.5)
        straight.step(sampler, 0.2)
    resumed = trainer(size)
    assert restore_checkpoint(resumed, tmp_path / "c.safetensors") == 1.5
    for _ in range(2):
        resumed.step(sampler, 0.2)
    for part in ("network", "average"):
        expected, found = getattr(straight, part).state_dict(), getattr(resumed, part).state_dict()
        for name, value in expected.items():
            torch.testing.assert_close(found[name], value, msg=name)


def test_a_checkpoint_of_another_plan_or_a_cut_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.safetensors"
    save_checkpoint(trainer(), path, seconds=0.0)
    for other in (Trainer(replace(PLAN, alpha=9.0), SMALL), trainer(SMALL_STACKED)):
        with pytest.raises(WeightsError, match="other training settings"):
            restore_checkpoint(other, path)
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(WeightsError, match="not a complete checkpoint"):
        restore_checkpoint(trainer(), path)


@pytest.mark.slow
@both_networks
def test_training_goes_on_after_an_interruption_and_ends_with_calibrated_weights_that_load(
    tmp_path: Path, size: PairArchitecture | StackedArchitecture
) -> None:
    plan = TrainingPlan(
        PLAN, size, minutes=None, steps=3, validations=1, minings=1, mined_scenes=1, validation_pairs=40
    )
    begun = trainer(size)
    begun.step(BatchSampler([tiny_shard()]), 0.0)
    save_checkpoint(begun, tmp_path / "checkpoint.safetensors", seconds=1.0)
    result = train(tiny_data(), plan, tmp_path)
    assert result.steps == 3
    assert result.pairs > begun.pairs
    assert result.best is not None
    assert result.best.drives is not None
    assert result.best.drives.far_pairs == tiny_drive().far.sum()
    assert (tmp_path / "validation.jsonl").read_text(encoding="utf-8").count("\n") == 1
    predictor = load_predictor(result.weights)
    assert predictor.architecture == size
    pairs, drives = evaluate_all_pairs(predictor, [tiny_drive()])
    assert pairs.pairs == 40 * 39
    assert drives == evaluate_drives(predictor, [tiny_drive()], np.random.default_rng(0))


@pytest.mark.slow
def test_validation_waits_while_it_took_more_than_a_tenth_of_the_time(tmp_path: Path) -> None:
    plan = TrainingPlan(PLAN, SMALL, minutes=0.05, validations=1000, minings=0, validation_pairs=20)
    train(tiny_data(), plan, tmp_path)
    assert 1 <= (tmp_path / "validation.jsonl").read_text(encoding="utf-8").count("\n") <= 6


def test_a_line_that_was_cut_hides_no_better_weights_of_an_interrupted_training(tmp_path: Path) -> None:
    plan = TrainingPlan(PLAN, SMALL, minutes=None, validation_pairs=20)
    begun = Validation(tiny_data(), plan, tmp_path, TensorBoardLog(tmp_path))
    begun.validate(trainer().network, 1, seconds=0.0)
    with (tmp_path / "validation.jsonl").open("a", encoding="utf-8") as log:
        log.write('{"seconds": 2, "sc')
    resumed = Validation(tiny_data(), plan, tmp_path, TensorBoardLog(tmp_path))
    assert begun.best is not None
    assert resumed.best is not None
    assert resumed.best.drives == begun.best.drives is not None


@pytest.mark.slow
def test_metrics_that_cannot_be_written_end_training_and_leave_what_was_kept(tmp_path: Path) -> None:
    plan = TrainingPlan(PLAN, SMALL, minutes=None, steps=4, validations=2, minings=0, validation_pairs=20)
    train(tiny_data(), plan, tmp_path)
    kept = (tmp_path / "weights.safetensors").read_bytes()
    (tmp_path / "validation.jsonl").unlink()
    (tmp_path / "validation.jsonl").mkdir()
    with pytest.raises(WeightsError, match="free some space"):
        train(tiny_data(), replace(plan, steps=8), tmp_path)
    assert (tmp_path / "weights.safetensors").read_bytes() == kept


def test_positives_are_drawn_more_evenly_over_distance_than_they_occur() -> None:
    shard, sampler = tiny_shard(), BatchSampler([tiny_shard()])
    batches = [sampler.draw(np.random.default_rng(seed), groups=6, pairs_per_group=12) for seed in range(20)]

    def far_share(waypoints: np.ndarray) -> float:
        return float((np.hypot(waypoints[:, 0], waypoints[:, 1]) > 0.8).mean())

    drawn = [b.waypoints(b.sources[b.reachable], b.targets[b.reachable]) for b in batches]
    reachable = shard.reachable
    existing = relative(shard.poses[shard.sources[reachable]], shard.poses[shard.targets[reachable]])
    assert far_share(np.concatenate(drawn)) > far_share(existing)


def test_a_batch_holds_both_ends_of_each_confusion_as_a_negative() -> None:
    shard, sampler = tiny_shard(), BatchSampler([tiny_shard()])
    batch = sampler.draw(np.random.default_rng(0), groups=3, pairs_per_group=2, confusions=[HardNegative(0, 0, 30)])
    assert not batch.reachable[-1]
    np.testing.assert_array_equal(batch.poses[batch.sources[-1]], shard.poses[0])
    np.testing.assert_array_equal(batch.poses[batch.targets[-1]], shard.poses[30])


@both_networks
def test_mined_confusions_are_far_pairs(size: PairArchitecture | StackedArchitecture) -> None:
    shard, learning = tiny_shard(), trainer(size)
    rng = np.random.default_rng(0)
    found = mine_hard_negatives(learning.average, FLOAT32, shard, 0, FarCriterion(), rng, images=30)
    assert found
    for confusion in found:
        pair = shard.poses[[confusion.source, confusion.target]]
        assert FarCriterion().pairs(pair[:1], pair[1:])[0, 0]


def test_the_rate_rises_then_falls() -> None:
    assert learning_rate_schedule(0.0, 0.1) < learning_rate_schedule(0.05, 0.1) < learning_rate_schedule(0.1, 0.1) == 1
    assert learning_rate_schedule(1.0, 0.1) == pytest.approx(0.01)


def test_calibration_recovers_a_known_scale_and_offset() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 2, 20000)
    positive = rng.random(20000) < 1 / (1 + np.exp(-(0.5 * logits - 0.7)))
    assert fit_platt(logits, positive) == pytest.approx((0.5, -0.7), abs=0.06)
