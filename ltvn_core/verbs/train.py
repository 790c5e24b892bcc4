"""`ltvn train`: a dataset becomes weights with a card."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.verbs.dataset import open_world
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.data.shards import Shard
    from ltvn_core.model.assessment import Drive
    from ltvn_core.model.card import Card, Measured
    from ltvn_core.model.training import TrainingData, TrainingPlan, TrainingResult

VALIDATION = ("tune-0", "tune-1", "tune-2")
"""Scenes by which the best weights are chosen."""

UNSEEN = ("tune-3", "tune-4", "tune-5", "tune-6", "tune-7", "tune-8")
"""Scenes on which the figures of the card are measured."""


@dataclass(frozen=True)
class Trained:
    """New weights and their figures on scenes that training has not seen."""

    weights: Path
    fingerprint: str
    steps: int
    pairs: int
    """Pairs compared."""
    minutes: float
    auc: float
    """On all ordered image pairs of drives, as are the others."""
    position_median_m: float
    position_p90_m: float
    yaw_median_deg: float
    ece: float
    far_fpr_at_tpr60: float


@dataclass(frozen=True, kw_only=True)
class Train(Verb):
    """Train the network on a dataset; goes on from the checkpoint in `work` if there is one."""

    data: Path = Path("data")
    """The folder of `ltvn dataset`."""
    output: Path
    """The weights to write; a card is written beside them."""
    work: Path = Path("data/training")
    """Where checkpoints and validation figures go."""
    minutes: float = 45.0
    """How long to train."""
    processes: int = 2
    """Processes of one thread each that train together."""
    seed: int = 0
    """Draws initial weights, batches and augmentation."""

    def run(self) -> Summary:
        """Train, measure and save; raises DatasetError, SceneError and WeightsError."""
        from ltvn_core.model.learner import LearningPlan
        from ltvn_core.model.training import TrainingPlan, train_together
        from ltvn_core.model.weights import load_weights, save_weights

        plan = TrainingPlan(LearningPlan(seed=self.seed), minutes=self.minutes)
        result = train_together(LoadTraining(self.data), plan, self.work, processes=self.processes)
        measured = measure(result.weights, self.data / "unseen")
        card = self._card(plan, result, measured)
        fingerprint = save_weights(load_weights(result.weights), self.output, asdict(card))
        return summary(self.output, fingerprint, card)

    def _card(self, plan: "TrainingPlan", result: "TrainingResult", measured: "Measured") -> "Card":
        from ltvn_core.model.card import Card, TrainedOn

        learned, _ = read_shards(self.data)
        return Card(
            TrainedOn(
                tuple(shard.name for shard in learned),
                VALIDATION,
                sum(len(shard.rgb) for shard in learned),
                sum(len(shard.sources) for shard in learned),
                learned[0].recipe,
            ),
            plan,
            result.steps,
            result.pairs,
            result.seconds / 60,
            self.processes,
            (
                f"ltvn dataset --folder data --clusters {len(set(learned[0].group.tolist()))}",
                f"ltvn train --data data --output {self.output.name} --minutes {self.minutes:g} "
                f"--processes {self.processes} --seed {self.seed}",
            ),
            measured,
        )


@dataclass(frozen=True)
class LoadTraining:
    """Loads a dataset in each process of a training."""

    folder: Path

    def __call__(self) -> "TrainingData":
        """Read all shards; validation scenes also give drives. Raises DatasetError."""
        from ltvn_core.model.training import TrainingData

        learned, validation = read_shards(self.folder)
        return TrainingData(learned, validation, drives(VALIDATION, images=220))


def read_shards(folder: Path) -> "tuple[list[Shard], list[Shard]]":
    """Return a dataset's shards to learn from and to validate on. Raises DatasetError if there are none of a kind."""
    from ltvn_core.data.shards import read_shard
    from ltvn_core.errors import DatasetError

    shards = [read_shard(path) for path in sorted(folder.glob("*.pairs.safetensors"))]
    learned = [shard for shard in shards if shard.name not in VALIDATION + UNSEEN]
    validation = [shard for shard in shards if shard.name in VALIDATION]
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of scenes to learn from and of {', '.join(VALIDATION)}, found "
            f"{', '.join(shard.name for shard in shards) or 'none'}; run `ltvn dataset --folder {folder}`."
        )
    return learned, validation


def drives(names: Sequence[str], *, images: int) -> "list[Drive]":
    """Look along a drive through each of the named scenes. Raises SceneError."""
    import numpy as np

    from ltvn_core.data.drives import classify_pairs, drive_poses
    from ltvn_core.data.generate import label_all, render_all
    from ltvn_core.data.labels import Limits
    from ltvn_core.model.assessment import Drive

    found = []
    for name in names:
        world = open_world(name)
        poses = drive_poses(world.floor, np.random.default_rng(0), images)
        rgb, depth_mm = render_all(world.camera, poses)
        first, second = np.divmod(np.arange(images**2), images)
        labels = label_all(world, poses, depth_mm, first, second, Limits())
        near, far = classify_pairs(poses, world.floor)
        found.append(Drive(name, rgb, depth_mm, near, far, poses, labels.reachable.reshape(images, images)))
    return found


def measure(weights: Path, folder: Path) -> "Measured":
    """Measure weights on the unseen scenes, whose labelled pairs are kept in a folder. Raises WeightsError."""
    import numpy as np

    from ltvn_core.data.generate import DatasetRecipe, generate
    from ltvn_core.data.shards import read_shard
    from ltvn_core.model.assessment import assess_all_pairs, assess_drives, assess_pairs
    from ltvn_core.model.card import Measured
    from ltvn_core.model.predictor import load_predictor

    predictor, rng = load_predictor(weights), np.random.default_rng(0)
    shards = [read_shard(path) for path in generate(UNSEEN, open_world, folder, DatasetRecipe(clusters=180))]
    seen = drives(UNSEEN, images=300)
    return Measured(
        UNSEEN,
        assess_pairs(predictor, shards, rng),
        assess_all_pairs(predictor, seen),
        assess_drives(predictor, seen, rng),
    )


def summary(weights: Path, fingerprint: str, card: "Card") -> Trained:
    """Return the figures that matter most."""
    pairs = card.measured.drive_pairs
    return Trained(
        weights,
        fingerprint,
        card.steps,
        card.pairs_compared,
        card.minutes,
        pairs.auc,
        pairs.position_median_m,
        pairs.position_p90_m,
        pairs.yaw_median_deg,
        pairs.ece,
        card.measured.drives.far_fpr_at_tpr60,
    )
