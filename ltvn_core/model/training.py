"""Training from first step to saved weights: when to learn, mine, validate, keep and stop.

Owns the course. One step is `ltvn_core.model.learner`; data come in as `Examples` and `Drive`s.
"""

import json
import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ltvn_core.errors import WeightsError
from ltvn_core.model.architecture import AnyArchitecture, Architecture
from ltvn_core.model.assessment import Drive, assess_drives, assess_pairs
from ltvn_core.model.checkpoint import resume, save_checkpoint
from ltvn_core.model.examples import ExamplePool, Examples
from ltvn_core.model.figures import DriveFigures, PairFigures
from ltvn_core.model.finetuner import FineTuner
from ltvn_core.model.learner import Learner, StepReport, schedule
from ltvn_core.model.learning_plan import LearningPlan
from ltvn_core.model.memory import keep_freed_memory
from ltvn_core.model.mining import find_confusions
from ltvn_core.model.precision import Precision, choose_precision
from ltvn_core.model.predictor import NetworkPredictor
from ltvn_core.model.recalibration import calibrate
from ltvn_core.model.scalars import Scalars
from ltvn_core.model.team import ALONE, Team, run_team
from ltvn_core.model.weights import load_weights, save_weights

log = logging.getLogger(__name__)

_CHECKPOINT_SECONDS = 60.0

_SCALARS_EVERY = 20
"""Steps between points of the curves."""


@dataclass(frozen=True, slots=True)
class TrainingPlan:
    """How long to train and how often to look (all ours)."""

    learning: LearningPlan = field(default_factory=LearningPlan)
    """What each step does."""
    architecture: AnyArchitecture = field(default_factory=Architecture)
    """The network to train."""
    minutes: float | None = 45.0
    """Time to train for; None trains for `steps`."""
    steps: int = 6000
    """Steps to train for where no time is given."""
    validations: int = 7
    """How many times to validate, evenly over training; the best weights are kept."""
    minings: int = 14
    """How many times to search for confusions, evenly over training after its first tenth."""
    mined_scenes: int = 4
    """Training scenes that each process searches each time."""
    patience: int = 4
    """Stop after this many validations in a row without a better one."""
    validation_pairs: int = 2500
    """Labelled pairs of each validation scene to look at during training,"""
    validation_far: int = 12000
    """and far pairs of each drive."""


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
    best: Assessment | None
    """Their figures on validation, before calibration; only the leading process knows them."""
    steps: int
    """Steps in all."""
    pairs: int
    """Pairs compared, about: all processes draw nearly the same number."""
    seconds: float
    """Time in all."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """What a network is trained and judged on."""

    scenes: Sequence[Examples]
    """To learn from."""
    validation: Sequence[Examples]
    """To choose the best weights and the calibration by."""
    drives: Sequence[Drive] = ()
    """To count wormholes on, in scenes that are not learned from."""


def train(
    data: TrainingData, plan: TrainingPlan, folder: Path, team: Team = ALONE, *, start: Path | None = None
) -> TrainingResult:
    """Train, keep the best weights on the validation data in `folder`, and return their path.

    Begins at random, or at trained weights (`start`, without a graphics card), whose architecture then counts. A
    checkpoint in the folder is resumed. Raises WeightsError if that is of another plan, or if `start` cannot be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    keep_freed_memory()
    return _Course(data, plan, folder, team, start).run()


def train_together(
    load: Callable[[], TrainingData], plan: TrainingPlan, folder: Path, *, processes: int
) -> TrainingResult:
    """Train in several processes, each of which loads the data itself; `load` must be picklable."""
    return run_team(partial(_train_member, load, plan, folder), processes)


def _train_member(load: Callable[[], TrainingData], plan: TrainingPlan, folder: Path, team: Team) -> TrainingResult:
    if team.size > 1:
        logging.basicConfig(level=logging.INFO if team.leads else logging.WARNING, format="%(asctime)s %(message)s")
    return train(load(), plan, folder, team)


class _Course:
    """The state of one training."""

    def __init__(self, data: TrainingData, plan: TrainingPlan, folder: Path, team: Team, start: Path | None) -> None:
        self.data, self.plan, self.folder, self.team = data, plan, folder, team
        self.pool = ExamplePool(data.scenes, evened=plan.learning.evened)
        self.learner = _learner(plan, team, start)
        self.checkpoint, self.best_path = folder / "checkpoint.safetensors", folder / "best.safetensors"
        self.spent = resume(self.learner, self.checkpoint) if self.checkpoint.exists() else 0.0
        self.best = _read_best(folder)
        self.worse_in_a_row = 0
        self.scalars = Scalars(folder / "tensorboard") if team.leads else None

    def run(self) -> TrainingResult:
        precision = choose_precision(self.learner.network)
        start, saved = time.monotonic() - self.spent, time.monotonic()
        bar = tqdm(
            total=100.0,
            initial=round(100 * self.progress(), 1),
            desc="training",
            bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}",
            disable=not self.team.leads,
            mininterval=1.0,
        )
        mean = math.nan
        while (before := self.progress()) < 1 and self.team.follow(self.worse_in_a_row) < self.plan.patience:
            report = self.learner.step(self.pool, precision, before, self.team)
            self.spent = self.team.follow(time.monotonic() - start)
            mean = report.loss if math.isnan(mean) else 0.98 * mean + 0.02 * report.loss
            bar.set_postfix(step=self.learner.steps, loss=f"{mean:.3f}", refresh=False)
            bar.update(100 * min(self.progress(), 1) - bar.n)
            self._plot(report)
            self._look_up(before, precision)
            if self.team.leads and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                save_checkpoint(self.learner, self.checkpoint, seconds=self.spent)
                saved = time.monotonic()
        bar.close()
        return self._finish()

    def progress(self) -> float:
        """Return the share of training that is done."""
        if self.plan.minutes is None:
            return self.learner.steps / self.plan.steps
        return self.spent / (60 * self.plan.minutes)

    def _plot(self, report: StepReport) -> None:
        if self.scalars is None or self.learner.steps % _SCALARS_EVERY:
            return
        rate = self.plan.learning.rate * schedule(self.progress(), self.plan.learning.warm_up)
        self.scalars.add(
            self.learner.steps,
            training__loss=report.loss,
            training__total=report.total,
            training__rate=rate,
            training__pairs_per_s=self.learner.pairs / max(self.spent, 1e-3),
            training__confusions=len(self.learner.confusions),
        )

    def _look_up(self, before: float, precision: Precision) -> None:
        """Validate and mine where it is time to; while the leader validates, the others mine."""
        validating = _due(before, self.progress(), self.plan.validations, begin=0.0)
        mining = _due(before, self.progress(), self.plan.minings, begin=0.1)
        if validating and self.team.leads:
            self._validate()
        elif mining or (validating and self.plan.minings > 0 and self.progress() > 0.1):
            self._mine(precision)

    def _mine(self, precision: Precision) -> None:
        rng = np.random.default_rng([self.plan.learning.seed, self.learner.steps, self.team.rank, 1])
        scenes = self.data.scenes
        for number in rng.choice(len(scenes), min(self.plan.mined_scenes, len(scenes)), replace=False):
            scene, kept = scenes[int(number)], [c for c in self.learner.confusions if c.scene != number]
            found = find_confusions(self.learner.average, precision, scene, int(number), self.plan.learning.far, rng)
            self.learner.confusions = kept + found[:200]
        log.info("mined %d confusions", len(self.learner.confusions))

    def _validate(self) -> None:
        """Judge the averaged weights and keep them if they are the best so far."""
        predictor = NetworkPredictor(self.learner.average, "in training")
        rng = np.random.default_rng(0)
        found = Assessment(
            self.learner.steps,
            assess_pairs(predictor, self.data.validation, rng, limit=self.plan.validation_pairs),
            assess_drives(predictor, self.data.drives, rng, limit=self.plan.validation_far)
            if self.data.drives
            else None,
        )
        log.info("step %d: score %.3f %s %s", found.steps, found.score, found.pairs, found.drives)
        self._note(found)
        if self.scalars is not None:
            self.scalars.add_figures(found.steps, "pairs", asdict(found.pairs))
            self.scalars.add_figures(found.steps, "drives", asdict(found.drives) if found.drives else {})
        if self.best is None or found.score > self.best.score:
            self.best, self.worse_in_a_row = found, 0
            save_weights(self.learner.average, self.best_path)
        else:
            self.worse_in_a_row += 1

    def _note(self, found: Assessment) -> None:
        """Add figures to the folder's list, and keep them apart if they are the best so far."""
        line = json.dumps({"seconds": round(self.spent), "score": found.score, **asdict(found)})
        try:
            with (self.folder / "validation.jsonl").open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            if self.best is None or found.score > self.best.score:
                (self.folder / "best.json").write_text(json.dumps(asdict(found)), encoding="utf-8")
        except OSError as error:
            raise WeightsError(
                f"{self.folder}: figures could not be written ({error}); free some space and run again, which goes on "
                "from the last checkpoint."
            ) from error

    def _finish(self) -> TrainingResult:
        weights = self.folder / "weights.safetensors"
        if self.scalars is not None:
            self.scalars.close()
        if self.team.leads:
            save_checkpoint(self.learner, self.checkpoint, seconds=self.spent)
            if self.best is None or self.best.steps != self.learner.steps:
                self._validate()
            network = load_weights(self.best_path)
            calibrate(network, [(scene, np.arange(len(scene.sources))) for scene in self.data.validation])
            save_weights(network, weights)
        return TrainingResult(weights, self.best, self.learner.steps, self.learner.pairs, self.spent)


def _learner(plan: TrainingPlan, team: Team, start: Path | None) -> Learner:
    if start is not None:
        return FineTuner(plan.learning, load_weights(start))
    return Learner(plan.learning, plan.architecture, team.device)


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
