"""Fine-tuning from trained weights to those that know the robot's own place: when to learn, mine, judge and stop.

Owns the course. A step is `ltvn_core.model.finetuner`, its batches are `ltvn_core.model.mixed_pool`.
"""

import hashlib
import json
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

import numpy as np

from ltvn_core.errors import WeightsError
from ltvn_core.model.assessment import Drive, assess_drives, assess_pairs
from ltvn_core.model.augmentation import Augmentation
from ltvn_core.model.checkpoint import resume, save_checkpoint
from ltvn_core.model.contract import AnyNetwork
from ltvn_core.model.examples import Examples
from ltvn_core.model.figures import DriveFigures, PairFigures
from ltvn_core.model.finetuner import FineTuner
from ltvn_core.model.learning_plan import LearningPlan
from ltvn_core.model.mining import confusions_among, find_confusions
from ltvn_core.model.mixed_pool import MixedPool, OwnDrive
from ltvn_core.model.own_assessment import OwnFigures, assess_own_drive
from ltvn_core.model.precision import Precision, choose_precision
from ltvn_core.model.predictor import NetworkPredictor
from ltvn_core.model.recalibration import recalibrate
from ltvn_core.model.weights import load_weights, weights_fingerprint

log = logging.getLogger(__name__)

_CHECKPOINT_SECONDS = 30.0


@dataclass(frozen=True, slots=True)
class FineTuningPlan:
    """How to fine-tune (all ours)."""

    learning: LearningPlan = field(
        default_factory=lambda: LearningPlan(
            groups=8, confusions=4, rate=2e-4, warm_up=0.1, average=0.98, augmentation=Augmentation(hue=0.0)
        )
    )
    """What each step does: a tenth of the learning rate of training, and the place's own colours."""
    minutes: float | None = 3.0
    """Time to learn for; None learns for `steps`."""
    steps: int = 200
    """Steps to learn for where no time is given."""
    minings: int = 6
    """How many times to search for confusions, the first time at once."""
    validation_pairs: int = 1000
    """Labelled pairs of each simulated validation scene to judge by, and twice as many of the drive,"""
    validation_far: int = 5000
    """and far pairs of each drive, the own one too."""
    judge: bool = True
    """Judge the weights before and after; False saves that time where many are made and nobody reads the figures."""


@dataclass(frozen=True, eq=False)
class FineTuningData:
    """What weights are fine-tuned and judged on."""

    drive: OwnDrive
    """The robot's own drive."""
    scenes: Sequence[Examples]
    """Simulated scenes that keep the network from unlearning."""
    validation: Sequence[Examples]
    """Simulated scenes to judge and to calibrate by."""
    drives: Sequence[Drive] = ()
    """Simulated drives to count wormholes on."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How good weights are: at their own place and in simulation."""

    own: OwnFigures
    simulated: PairFigures
    simulated_drives: DriveFigures | None


@dataclass(frozen=True, slots=True)
class Progress:
    """Where fine-tuning stands."""

    share: float
    """In [0, 1]."""
    steps: int
    loss: float
    """Eq. 1, smoothed; nan before the first step."""
    doing: str
    """What is being done, for a person."""


@dataclass(frozen=True)
class FineTuned:
    """What fine-tuning ends with."""

    network: AnyNetwork
    """Averaged and calibrated."""
    parent: str
    """Fingerprint of the weights it started from."""
    before: Standing | None
    """None where nobody asked to judge."""
    after: Standing | None
    steps: int
    pairs: int
    """Pairs compared."""
    seconds: float


def finetune(
    data: FineTuningData,
    start: Path,
    plan: FineTuningPlan,
    folder: Path,
    *,
    on_progress: Callable[[Progress], None] | None = None,
    cancelled: Event | None = None,
) -> FineTuned | None:
    """Fine-tune weights on a drive; return None if it was cancelled, in which case a checkpoint waits in `folder`.

    A checkpoint of the same run is resumed. The starting weights are read and never written. `on_progress` is called
    in this thread, after every step. Raises WeightsError for weights that cannot be read, a checkpoint of another run
    and a full disk.
    """
    course = _Course(data, start, plan, folder, on_progress or _ignore, cancelled or Event())
    return course.run()


def drive_fingerprint(drive: OwnDrive) -> str:
    """Return 12 hexadecimal digits that name a drive and its labels."""
    found = hashlib.sha256(drive.name.encode())
    for part in (drive.poses, drive.sources, drive.targets, drive.reachable):
        found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()[:12]


class _Course:
    """The state of one fine-tuning."""

    def __init__(
        self,
        data: FineTuningData,
        start: Path,
        plan: FineTuningPlan,
        folder: Path,
        on_progress: Callable[[Progress], None],
        cancelled: Event,
    ) -> None:
        self.data, self.plan, self.on_progress, self.cancelled = data, plan, on_progress, cancelled
        self.start, self.parent = load_weights(start), weights_fingerprint(start)
        _require_same_run(folder / "run.json", {"parent": self.parent, "drive": drive_fingerprint(data.drive)})
        self.pool = MixedPool(data.drive, data.scenes, plan.learning.far, evened=plan.learning.evened)
        self.learner = FineTuner(plan.learning, self.start)
        self.checkpoint = folder / "checkpoint.safetensors"
        self.spent = resume(self.learner, self.checkpoint) if self.checkpoint.exists() else 0.0
        self.loss = float("nan")

    def run(self) -> FineTuned | None:
        before = self._judge(self.start, "before")
        try:
            finished = self._learn()
        finally:
            self._save()
        if not finished:
            return None
        self._report("calibrating")
        network = self.learner.average
        recalibrate(network, self.data.drive, self.data.validation)
        after = self._judge(network, "after")
        return FineTuned(network, self.parent, before, after, self.learner.steps, self.learner.pairs, self.spent)

    def _learn(self) -> bool:
        """Learn to the end and return True, or False if somebody cancelled."""
        precision = choose_precision(self.learner.network)
        start, saved, mined = time.monotonic() - self.spent, time.monotonic(), -1
        while (share := self._share()) < 1:
            if self.cancelled.is_set():
                return False
            if (due := int(share * self.plan.minings)) > mined and self.plan.minings:
                self._mine(precision)
                mined = due
            loss = self.learner.step(self.pool, precision, share).loss
            self.spent = time.monotonic() - start
            self.loss = loss if np.isnan(self.loss) else 0.95 * self.loss + 0.05 * loss
            self._report("learning")
            if time.monotonic() - saved > _CHECKPOINT_SECONDS:
                self._save()
                saved = time.monotonic()
        return True

    def _share(self) -> float:
        if self.plan.minutes is None:
            return min(self.learner.steps / self.plan.steps, 1.0)
        return min(self.spent / (60 * self.plan.minutes), 1.0)

    def _mine(self, precision: Precision) -> None:
        """Search the drive, and one simulated scene, for far pairs that are called reachable."""
        rng = np.random.default_rng([self.plan.learning.seed, self.learner.steps, 2])
        drive, network, number = self.data.drive, self.learner.average, self.pool.drive_number
        rows = np.sort(rng.permutation(self.pool.learnable)[:800])
        found = confusions_among(network, precision, drive, number, rows, drive.far(rows, rows), rng)[:300]
        if self.data.scenes:
            other = int(rng.integers(len(self.data.scenes)))
            scene = self.data.scenes[other]
            found += find_confusions(network, precision, scene, other, self.plan.learning.far, rng, images=500)[:100]
        self.learner.confusions = found
        log.info("step %d: mined %d confusions", self.learner.steps, len(found))

    def _judge(self, network: AnyNetwork, when: str) -> Standing | None:
        if not self.plan.judge:
            return None
        self._report(f"judging the weights {when}")
        predictor, plan = NetworkPredictor(network, "in fine-tuning"), self.plan
        rng = np.random.default_rng(0)
        return Standing(
            assess_own_drive(predictor, self.data.drive, rng, near=2 * plan.validation_pairs, far=plan.validation_far),
            assess_pairs(predictor, self.data.validation, rng, limit=plan.validation_pairs),
            assess_drives(predictor, self.data.drives, rng, limit=plan.validation_far) if self.data.drives else None,
        )

    def _save(self) -> None:
        save_checkpoint(self.learner, self.checkpoint, seconds=self.spent)

    def _report(self, doing: str) -> None:
        self.on_progress(Progress(self._share(), self.learner.steps, self.loss, doing))


def _require_same_run(path: Path, run: dict[str, str]) -> None:
    """Raise WeightsError if a folder holds a run from other weights or on another drive."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(json.dumps(run), encoding="utf-8")
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WeightsError(
            f"{path}: cannot be read or written ({error}); free some space, or delete {path.parent} to begin anew."
        ) from error
    if found != run:
        raise WeightsError(
            f"{path.parent}: holds an unfinished fine-tuning of weights {found.get('parent')} on {found.get('drive')}, "
            f"not of {run['parent']} on {run['drive']}; finish that one, name another output, or delete the folder."
        )


def _ignore(progress: Progress) -> None:
    """Nobody wants to know."""
