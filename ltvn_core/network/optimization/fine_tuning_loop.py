"""Fine-tuning: adapts trained weights to the environment of a robot, with mining and evaluation between the steps.

Weights are evaluated on the robot's own drive, with labels from odometry instead of ground truth, and in simulation.
"""

import hashlib
import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ltvn_core.errors import WeightsError
from ltvn_core.geometry import relative
from ltvn_core.network.base_network import FLOAT32, AnyNetwork
from ltvn_core.network.device import CPU
from ltvn_core.network.metrics import DriveMetrics, PairMetrics, drive_metrics, pair_metrics
from ltvn_core.network.optimization.augmentation import Augmentation
from ltvn_core.network.optimization.hard_negative_mining import hard_negatives_among, mine_hard_negatives
from ltvn_core.network.optimization.reachability_calibration import calibrate_after_fine_tuning
from ltvn_core.network.optimization.trainer import Hyperparameters, LearningLoop, Trainer
from ltvn_core.network.pair_evaluation import LabelledDrive, evaluate_drives, evaluate_pairs
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs
from ltvn_core.network.training_examples import HardNegative, MixedBatchSampler, SceneExamples
from ltvn_core.network.weights_file import load_weights, weights_fingerprint
from ltvn_core.structured_text import parse_json

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class TrajectoryMetrics:
    """Metrics on a robot's own drive, with labels from odometry."""

    pairs: PairMetrics
    """Metrics on labelled pairs at most H images apart."""
    far: DriveMetrics
    """Metrics on the reachable ones of these pairs, and on pairs farther apart than drift of odometry can explain."""


def evaluate_trajectory(
    predictor: NetworkPredictor, drive: TrajectoryPairs, rng: np.random.Generator, *, near: int, far: int
) -> TrajectoryMetrics:
    """Evaluate a predictor on random near and far pairs of a drive, up to the given numbers."""
    features = predictor.encode_images(drive.rgb, drive.depth_mm)
    chosen = rng.permutation(len(drive.sources))[:near]
    i = drive.sources[chosen].astype(np.intp)
    j = drive.targets[chosen].astype(np.intp)
    found = predictor.predict_rows(features, i, j)
    reachable = drive.reachable[chosen]
    true = relative(drive.poses[i], drive.poses[j])
    apart = predictor.predict_rows(features, *_far_pairs(drive, rng, far)).reachability
    return TrajectoryMetrics(pair_metrics(*found, reachable, true), drive_metrics(found.reachability[reachable], apart))


def _far_pairs(
    drive: TrajectoryPairs, rng: np.random.Generator, count: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Draw up to `count` ordered pairs of rows that are certainly far apart, spread over the whole drive."""
    among = np.arange(len(drive.poses))
    sources = [np.empty(0, np.intp)]
    targets = [np.empty(0, np.intp)]
    rows = rng.permutation(among)
    each = max(count // max(len(rows), 1), 1)
    for row in rows[:count]:
        away = among[drive.far(np.array([row]), among)[0]]
        drawn = rng.permutation(away)[:each]
        sources.append(np.full(len(drawn), row))
        targets.append(drawn)
    return np.concatenate(sources), np.concatenate(targets)


@dataclass(frozen=True, slots=True)
class FineTuningPlan:
    """Settings of fine-tuning (all values are ours)."""

    learning: Hyperparameters = field(
        default_factory=lambda: Hyperparameters(
            groups=8, confusions=4, rate=2e-4, warm_up=0.1, average=0.98, augmentation=Augmentation(hue=0.0)
        )
    )
    """Hyperparameters of a step: a tenth of the learning rate of training, and no augmentation of hues."""
    minutes: float | None = 3.0
    """Training time in minutes; None trains for `steps`."""
    steps: int = 200
    """Number of training steps if `minutes` is None."""
    minings: int = 6
    """Number of searches for hard negatives, the first one at the start."""
    validation_pairs: int = 1000
    """Labelled pairs per simulated validation scene; twice as many are taken from the drive."""
    validation_far: int = 5000
    """Far pairs per validation drive, including the user's own."""
    judge: bool = True
    """Whether to evaluate the weights before and after; False saves that time if the metrics are not needed."""


@dataclass(frozen=True, eq=False)
class FineTuningData:
    """The data for fine-tuning and its evaluation."""

    drive: TrajectoryPairs
    """The robot's own drive."""
    scenes: Sequence[SceneExamples]
    """Simulated training scenes, which prevent forgetting."""
    validation: Sequence[SceneExamples]
    """Simulated scenes for evaluation and calibration."""
    drives: Sequence[LabelledDrive] = ()
    """Simulated drives on which false long-range edges are counted."""


@dataclass(frozen=True, slots=True)
class FineTuningMetrics:
    """Metrics of weights on the robot's own drive and in simulation."""

    own: TrajectoryMetrics
    simulated: PairMetrics
    simulated_drives: DriveMetrics | None


@dataclass(frozen=True, slots=True)
class FineTuningProgress:
    """Progress of fine-tuning."""

    share: float
    """Finished share of the training, in [0, 1]."""
    steps: int
    loss: float
    """Eq. 1, smoothed; nan before the first step."""
    doing: str
    """The current activity, as text for a user."""


@dataclass(frozen=True)
class FineTuningResult:
    """The result of fine-tuning."""

    network: AnyNetwork
    """The network with averaged and calibrated weights."""
    parent: str
    """Fingerprint of the weights that fine-tuning started from."""
    before: FineTuningMetrics | None
    """Metrics before fine-tuning; None if the plan does not evaluate."""
    after: FineTuningMetrics | None
    """Metrics after fine-tuning; None if the plan does not evaluate."""
    steps: int
    pairs: int
    """Number of pairs compared."""
    seconds: float


def run_fine_tuning(
    data: FineTuningData,
    start: Path,
    plan: FineTuningPlan,
    folder: Path,
    *,
    on_progress: Callable[[FineTuningProgress], None] | None = None,
    device: torch.device = CPU,
) -> FineTuningResult:
    """Fine-tune weights on a drive.

    A checkpoint of the same run is resumed. The file of the starting weights is never changed. `on_progress` is called
    in this thread, after every step; an exception in it stops the work and leaves a checkpoint in `folder`. Raises
    WeightsError for weights that cannot be read, a checkpoint of another run and a full disk.
    """
    network = load_weights(start).to(device)
    run = {"parent": weights_fingerprint(start), "drive": trajectory_fingerprint(data.drive)}
    _require_same_run(folder / "run.json", run)
    sampler = MixedBatchSampler(data.drive, data.scenes, plan.learning.far, evened=plan.learning.evened)
    trainer = Trainer(plan.learning, device=device, start=network)
    loop = LearningLoop(trainer, sampler, folder, minutes=plan.minutes, steps=plan.steps)
    mined = -1

    def report(doing: str) -> None:
        if on_progress is not None:
            share = min(loop.progress(), 1.0)
            on_progress(FineTuningProgress(share=share, steps=trainer.steps, loss=loop.loss, doing=doing))

    def before_step(progress: float) -> bool:
        nonlocal mined
        if (due := int(progress * plan.minings)) > mined and plan.minings:
            trainer.confusions = _mined(trainer, sampler)
            mined = due
        return True

    def judged(weights: AnyNetwork, when: str) -> FineTuningMetrics | None:
        if not plan.judge:
            return None
        report(f"judging the weights {when}")
        return _evaluate(weights, data, plan)

    judged_before = judged(network, "before")
    # Saved also when interrupted, so that the next run with this folder continues here.
    try:
        loop.learn(before_step, lambda before, losses: report("learning"))
    finally:
        loop.save()
    report("calibrating")
    calibrate_after_fine_tuning(trainer.average, data.drive, data.validation)
    return FineTuningResult(
        network=trainer.average,
        parent=run["parent"],
        before=judged_before,
        after=judged(trainer.average, "after"),
        steps=trainer.steps,
        pairs=trainer.pairs,
        seconds=loop.elapsed_s,
    )


def _mined(trainer: Trainer, sampler: MixedBatchSampler) -> list[HardNegative]:
    """Search the drive and one simulated scene for hard negatives."""
    rng = np.random.default_rng([trainer.plan.seed, trainer.steps, 2])
    drive, network = sampler.drive, trainer.average
    rows = np.sort(rng.permutation(sampler.learnable)[:800])
    found = hard_negatives_among(network, FLOAT32, drive, sampler.drive_number, rows, drive.far(rows, rows), rng)[:300]
    if sampler.scenes:
        other = int(rng.integers(len(sampler.scenes)))
        scene = sampler.scenes[other]
        found += mine_hard_negatives(network, FLOAT32, scene, other, sampler.far, rng, images=500)[:100]
    log.info("step %d: mined %d confusions", trainer.steps, len(found))
    return found


def _evaluate(network: AnyNetwork, data: FineTuningData, plan: FineTuningPlan) -> FineTuningMetrics:
    predictor = NetworkPredictor(network, "in fine-tuning")
    # The same pairs before and after, so that the difference is due to the weights alone.
    rng = np.random.default_rng(0)
    return FineTuningMetrics(
        evaluate_trajectory(predictor, data.drive, rng, near=2 * plan.validation_pairs, far=plan.validation_far),
        evaluate_pairs(predictor, data.validation, rng, limit=plan.validation_pairs),
        evaluate_drives(predictor, data.drives, rng, limit=plan.validation_far) if data.drives else None,
    )


def trajectory_fingerprint(drive: TrajectoryPairs) -> str:
    """Return a fingerprint of 12 hexadecimal digits of a drive and its labels."""
    found = hashlib.sha256(drive.name.encode())
    for part in (drive.poses, drive.sources, drive.targets, drive.reachable):
        found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()[:12]


def _require_same_run(path: Path, run: dict[str, str]) -> None:
    """Raise WeightsError if a folder contains a run from other weights or on another drive."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(json.dumps(run), encoding="utf-8")
        found = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WeightsError(
            f"{path}: cannot be read or written ({error}); free some space, or delete {path.parent} to start over."
        ) from error
    if found != run:
        raise WeightsError(
            f"{path.parent}: holds an unfinished fine-tuning of weights {found.get('parent')} on {found.get('drive')}, "
            f"not of {run['parent']} on {run['drive']}; finish that one, name another output, or delete the folder."
        )
