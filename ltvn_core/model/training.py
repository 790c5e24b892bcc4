"""Training from first step to saved weights: when to learn, mine, validate, keep and stop.

Owns the course. One step is `ltvn_core.model.learner`; data come in as `Examples` and `Drive`s.
"""

import json
import logging
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from ltvn_core.model.assessment import Drive, assess_drives, assess_pairs, encode_images, predict_pairs
from ltvn_core.model.calibration import fit_platt, logit
from ltvn_core.model.checkpoint import resume, save_checkpoint
from ltvn_core.model.examples import ExamplePool, Examples
from ltvn_core.model.figures import DriveFigures, PairFigures
from ltvn_core.model.learner import Learner, LearningPlan
from ltvn_core.model.mining import find_confusions
from ltvn_core.model.network import PairNetwork
from ltvn_core.model.precision import Precision, choose_precision
from ltvn_core.model.predictor import NetworkPredictor
from ltvn_core.model.weights import load_weights, save_weights

log = logging.getLogger(__name__)

_CHECKPOINT_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class TrainingPlan:
    """How long to train and how often to look (all ours)."""

    learning: LearningPlan = field(default_factory=LearningPlan)
    """What each step does."""
    minutes: float | None = 45.0
    """Time to train for; None trains for `steps`."""
    steps: int = 6000
    """Steps to train for where no time is given."""
    validations: int = 7
    """How many times to validate, evenly over training; the best weights are kept."""
    minings: int = 15
    """How many times to search for confusions, evenly over training after its first tenth."""
    mined_scenes: int = 8
    """Training scenes searched each time."""
    patience: int = 4
    """Stop after this many validations in a row without a better one."""
    validation_pairs: int = 2500
    """Labelled pairs of each validation scene to look at during training."""


@dataclass(frozen=True, slots=True)
class Assessment:
    """Figures of one validation."""

    steps: int
    pairs: PairFigures
    drives: DriveFigures | None

    @property
    def score(self) -> float:
        """Return what the best weights have the most of: few wormholes first, then ranking and pose."""
        wormholes = 0.0 if self.drives is None else -math.log10(self.drives.far_fpr_at_tpr60 + 1e-5)
        return wormholes + 20 * (self.pairs.auc or 0) - 5 * self.pairs.position_median_m


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """What training ends with."""

    weights: Path
    """The best weights, calibrated."""
    best: Assessment
    """Their figures on validation, before calibration."""
    steps: int
    """Steps in all."""
    pairs: int
    """Pairs compared in this run."""
    seconds: float
    """Time in all."""


def train(
    scenes: Sequence[Examples],
    validation: Sequence[Examples],
    drives: Sequence[Drive],
    plan: TrainingPlan,
    folder: Path,
) -> TrainingResult:
    """Train on scenes, keep the best weights on the validation scenes and drives in `folder`, and return their path.

    A checkpoint in the folder is resumed. Raises WeightsError if that is of another plan.
    """
    course = _Course(scenes, validation, drives, plan, folder)
    return course.run()


class _Course:
    """The state of one training."""

    def __init__(
        self,
        scenes: Sequence[Examples],
        validation: Sequence[Examples],
        drives: Sequence[Drive],
        plan: TrainingPlan,
        folder: Path,
    ) -> None:
        self.plan, self.folder = plan, folder
        self.scenes, self.validation, self.drives = scenes, validation, drives
        self.pool = ExamplePool(scenes)
        self.learner = Learner(plan.learning)
        self.checkpoint, self.best_path = folder / "checkpoint.safetensors", folder / "best.safetensors"
        self.spent = resume(self.learner, self.checkpoint) if self.checkpoint.exists() else 0.0
        self.best = _read_best(folder)
        self.worse_in_a_row = 0
        self.pairs = 0

    def run(self) -> TrainingResult:
        precision = choose_precision(self.learner.network)
        start, saved = time.monotonic() - self.spent, time.monotonic()
        bar = tqdm(
            total=100.0,
            initial=round(100 * self.progress(), 1),
            desc="training",
            unit="%",
            bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}",
        )
        mean = math.nan
        while (progress := self.progress()) < 1 and self.worse_in_a_row < self.plan.patience:
            report = self.learner.step(self.pool, precision, progress)
            self.spent = time.monotonic() - start
            self.pairs += report.pairs
            mean = report.loss if math.isnan(mean) else 0.98 * mean + 0.02 * report.loss
            bar.set_postfix(step=self.learner.steps, loss=f"{mean:.3f}", images=report.images, pairs=report.pairs)
            bar.update(100 * min(self.progress(), 1) - bar.n)
            if _due(progress, self.progress(), self.plan.minings, begin=0.1):
                self._mine(precision)
            if _due(progress, self.progress(), self.plan.validations, begin=0.0):
                self._validate()
            if time.monotonic() - saved > _CHECKPOINT_SECONDS:
                save_checkpoint(self.learner, self.checkpoint, seconds=self.spent)
                saved = time.monotonic()
        bar.close()
        return self._finish()

    def progress(self) -> float:
        """Return the share of training that is done."""
        if self.plan.minutes is None:
            return self.learner.steps / self.plan.steps
        return self.spent / (60 * self.plan.minutes)

    def _mine(self, precision: Precision) -> None:
        rng = np.random.default_rng([self.plan.learning.seed, self.learner.steps, 1])
        for number in rng.choice(len(self.scenes), min(self.plan.mined_scenes, len(self.scenes)), replace=False):
            scene, kept = self.scenes[int(number)], [c for c in self.learner.confusions if c.scene != number]
            found = find_confusions(self.learner.average, precision, scene, int(number), self.plan.learning.far, rng)
            self.learner.confusions = kept + found[:200]
        log.info("mined %d confusions", len(self.learner.confusions))

    def _validate(self) -> None:
        """Judge the averaged weights and keep them if they are the best so far."""
        predictor = NetworkPredictor(self.learner.average, "in training")
        rng = np.random.default_rng(0)
        found = Assessment(
            self.learner.steps,
            assess_pairs(predictor, self.validation, rng, limit=self.plan.validation_pairs),
            assess_drives(predictor, self.drives) if self.drives else None,
        )
        log.info("step %d: score %.3f %s %s", found.steps, found.score, found.pairs, found.drives)
        with (self.folder / "validation.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps({"seconds": round(self.spent), "score": found.score, **asdict(found)}) + "\n")
        if self.best is None or found.score > self.best.score:
            self.best, self.worse_in_a_row = found, 0
            save_weights(self.learner.average, self.best_path)
            (self.folder / "best.json").write_text(json.dumps(asdict(found)), encoding="utf-8")
        else:
            self.worse_in_a_row += 1

    def _finish(self) -> TrainingResult:
        save_checkpoint(self.learner, self.checkpoint, seconds=self.spent)
        if self.best is None or self.best.steps != self.learner.steps:
            self._validate()
        assert self.best is not None  # `_validate` keeps the first.
        network = load_weights(self.best_path)
        calibrate(network, self.validation)
        weights = self.folder / "weights.safetensors"
        save_weights(network, weights)
        return TrainingResult(weights, self.best, self.learner.steps, self.pairs, self.spent)


def calibrate(network: PairNetwork, scenes: Sequence[Examples]) -> None:
    """Fit the network's calibration on all labelled pairs of scenes."""
    network.calibration.copy_(torch.tensor([1.0, 0.0]))
    predictor = NetworkPredictor(network, "in calibration")
    logits, positive = [], []
    for scene in scenes:
        features = encode_images(predictor, scene.rgb, scene.depth_mm)
        rows = (scene.sources.astype(np.intp), scene.targets.astype(np.intp))
        logits.append(logit(predict_pairs(predictor, features, *rows).reachability))
        positive.append(scene.reachable)
    network.calibration.copy_(torch.tensor(fit_platt(np.concatenate(logits), np.concatenate(positive))))


def _due(before: float, after: float, times: int, *, begin: float) -> bool:
    """Tell whether one of `times` evenly spaced moments after `begin` lies in (before, after]."""
    if times == 0:
        return False
    spacing = (1 - begin) / times
    return math.floor((after - begin) / spacing) > math.floor((before - begin) / spacing) and after >= begin + 1e-9


def _read_best(folder: Path) -> Assessment | None:
    """Return the figures of the best weights of an interrupted training."""
    try:
        found = json.loads((folder / "best.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    drives = DriveFigures(**found["drives"]) if found["drives"] else None
    return Assessment(found["steps"], PairFigures(**found["pairs"]), drives)
