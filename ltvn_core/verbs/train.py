"""`ltvn train`: a dataset becomes weights with a card."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ltvn_core.errors import OptionError
from ltvn_core.training.held_out_scenes import (
    CLUSTERS_PER_SCENE,
    IMAGES_PER_DRIVE,
    TEST_SCENES,
    VALIDATION_SCENES,
    NetworkMetrics,
    drives,
    figures,
    measure_network,
)
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.model_card import HeldOutMetrics, InferenceSpeed, ModelCard
    from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, TrainingResult
    from ltvn_core.training_data.shards import Shard

_VALIDATION_DRIVE = 220
"""Images of the drive through each validation scene,"""
_SHORT_DRIVE = 60
"""and where training is so short that rendering and comparing them would take longer than training,"""
_FEW_STEPS = 1000
"""in fewer steps than these. A fifth of the pairs is compared then."""


@dataclass(frozen=True)
class TrainSummary:
    """New weights and their figures in scenes that training has not seen."""

    weights: Path
    steps: int
    pairs_compared: int
    minutes: float
    parameters: int
    encode_ms: float
    """Per image,"""
    pair_ms: float
    """and per pair of encoded images, on this machine."""
    figures: NetworkMetrics


@dataclass(frozen=True)
class NetworkEvaluationSummary(NetworkMetrics):
    """Figures of weights, and of the paper's plain network beside them."""

    stacked: NetworkMetrics | None
    """None unless --stacked names some."""


@dataclass(frozen=True, kw_only=True)
class TrainVerb(Verb):
    """Train the network on a dataset; goes on from the checkpoint in `work` if there is one."""

    data: Path = Path("data")
    """The folder of `ltvn dataset`; labelled pairs of the scenes to measure on are kept in `unseen` below it."""
    architecture: Literal["aligned-pairs", "stacked"] = "aligned-pairs"
    """The network: tokens matched and aligned, or the paper's plain network over both images stacked."""
    output: Path | None = None
    """The weights to write; a card is written beside them."""
    work: Path = Path("data/training")
    """Where checkpoints, curves and validation figures go."""
    minutes: float = 45.0
    """How long to train,"""
    steps: int | None = None
    """or for how many steps: takes longer on a slower machine, but gives the same weights."""
    processes: int | None = None
    """Processes that train together: one for each graphics card, or without one, two of one thread each."""
    seed: int = 0
    """Draws initial weights, batches and augmentation."""
    evaluate: bool = False
    """Train nothing: measure weights that are there."""
    weights: Path | None = None
    """With --evaluate: the weights to measure instead of the shipped ones,"""
    stacked: Path | None = None
    """and weights of a plain network to measure beside them, made with --architecture stacked."""
    scenes: tuple[str, ...] = TEST_SCENES
    """The scenes to measure on, by name or by the path of a mesh,"""
    clusters: int = CLUSTERS_PER_SCENE
    """clusters of labelled pairs in each of them,"""
    images: int = IMAGES_PER_DRIVE
    """and images of the drive through each of them."""

    def run(self) -> Summary:
        """Train, measure and save; raises OptionError, DatasetError, SceneError and WeightsError."""
        if self.evaluate:
            return self._evaluate()
        from ltvn_core.network.model_card import measure_speed
        from ltvn_core.network.optimization.training_loop import train_distributed
        from ltvn_core.network.weights_file import load_weights, save_weights

        output = self._checked_output()
        plan = self._plan()
        load = LoadTrainingData(self.data, images=_SHORT_DRIVE if self._is_short else _VALIDATION_DRIVE)
        result = train_distributed(load, plan, self.work, processes=self._processes())
        network = load_weights(result.weights)
        measured = self._measure(result.weights)
        card = self._card(output, plan, result, measure_speed(network), measured)
        save_weights(network, output, asdict(card))
        speed, found = card.speed, figures(output, measured)
        times = (speed.parameters, speed.encode_ms, speed.pair_ms)
        return TrainSummary(output, card.steps, card.pairs_compared, card.minutes, *times, found)

    def _plan(self) -> "TrainingPlan":
        from ltvn_core.network.network_families import default_architecture
        from ltvn_core.network.optimization.trainer import Hyperparameters
        from ltvn_core.network.optimization.training_loop import TrainingPlan

        plan = TrainingPlan(
            Hyperparameters(seed=self.seed), default_architecture(self.architecture), minutes=self.minutes
        )
        if self.architecture == "stacked":  # It pays for every pair from the pixels on, so it is validated on fewer.
            plan = replace(plan, validation_pairs=plan.validation_pairs // 4, validation_far=plan.validation_far // 4)
        if self.steps is None:
            return plan
        looks = min(max(self.steps // 100, 1), plan.validations)
        if self._is_short:
            plan = replace(plan, validation_pairs=plan.validation_pairs // 5, validation_far=plan.validation_far // 5)
        return replace(plan, minutes=None, steps=self.steps, validations=looks, minings=2 * looks)

    @property
    def _is_short(self) -> bool:
        """Whether this is a trial of few steps, which would wait longer for a whole validation than for training."""
        return self.steps is not None and self.steps < _FEW_STEPS

    def _evaluate(self) -> NetworkEvaluationSummary:
        from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS

        def judge(weights: Path) -> NetworkMetrics:
            return figures(weights, self._measure(weights))

        found = judge(self.weights or SHIPPED_WEIGHTS)
        stacked = None if self.stacked is None else judge(self.stacked)
        return NetworkEvaluationSummary(**vars(found), stacked=stacked)

    def _measure(self, weights: Path) -> "HeldOutMetrics":
        folder = self.data / "unseen"
        return measure_network(weights, folder, self.scenes, clusters=self.clusters, images=self.images)

    def _processes(self) -> int:
        from ltvn_core.network.device import gpu_count

        return self.processes or gpu_count() or 2

    def _checked_output(self) -> Path:
        """Return the output. Raises OptionError if there is none or weights lie there already."""
        if self.output is None:
            raise OptionError("--output is missing: name the weights to write, for instance --output my.safetensors.")
        if self.output.exists():
            raise OptionError(f"{self.output} exists; nothing is overwritten. Name another --output or move it away.")
        return self.output

    def _card(
        self,
        output: Path,
        plan: "TrainingPlan",
        result: "TrainingResult",
        speed: "InferenceSpeed",
        measured: "HeldOutMetrics",
    ) -> "ModelCard":
        from ltvn_core.network.model_card import ModelCard, TrainingDataSummary

        learned, _ = read_shards(self.data)
        return ModelCard(
            TrainingDataSummary(
                tuple(shard.name for shard in learned),
                VALIDATION_SCENES,
                sum(len(shard.rgb) for shard in learned),
                sum(len(shard.sources) for shard in learned),
                learned[0].recipe,
            ),
            plan,
            result.steps,
            result.pairs,
            result.seconds / 60,
            self._processes(),
            (
                f"ltvn dataset --folder data --clusters {len(set(learned[0].group.tolist()))}",
                f"ltvn train --data data --architecture {self.architecture} --output {output.name} "
                + (f"--minutes {self.minutes:g}" if self.steps is None else f"--steps {self.steps}")
                + f" --processes {self._processes()} --seed {self.seed}",
            ),
            speed,
            measured,
        )


@dataclass(frozen=True)
class LoadTrainingData:
    """Loads a dataset in each process of a training."""

    folder: Path
    images: int
    """Images of the drive through each validation scene."""

    def __call__(self) -> "TrainingData":
        """Read all shards; validation scenes also give drives. Raises DatasetError."""
        from ltvn_core.network.optimization.training_loop import TrainingData

        learned, validation = read_shards(self.folder)
        return TrainingData(learned, validation, drives([shard.name for shard in validation], images=self.images))


def read_shards(folder: Path) -> "tuple[list[Shard], list[Shard]]":
    """Return a dataset's shards to learn from and to validate on. Raises DatasetError if there are none of a kind."""
    from ltvn_core.errors import DatasetError
    from ltvn_core.training_data.shards import dataset_shards, read_shard, split_shards

    shards = [read_shard(path) for path in dataset_shards(folder)]
    learned, validation = split_shards((shard for shard in shards if shard.name not in TEST_SCENES), VALIDATION_SCENES)
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of scenes to learn from and of {', '.join(VALIDATION_SCENES)}, found "
            f"{', '.join(shard.name for shard in shards) or 'none'}; run `ltvn dataset --folder {folder}`."
        )
    return learned, validation
