"""Trains the network of another system on its own temporal labels, for `ltvn train --system`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.entry import TemporalLearning
from ltvn_core.systems.registry import DEFAULT_SYSTEM, baseline_systems, system_entry
from ltvn_core.training.held_out_scenes import VALIDATION_SCENES, training_data_summary
from ltvn_core.verbs.option_types import DeviceOption, SystemName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from ltvn_core.network.baseline_training import BaselineCard
    from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, TrainingResult

_MINUTES = 8.0


@dataclass(frozen=True)
class RivalSummary:
    """The new weights, and their accuracy on the rival's labels in scenes without training."""

    weights: Path
    fingerprint: str
    images: int
    pairs: int
    """Number of labelled pairs."""
    steps: int
    pairs_compared: int
    minutes: float
    before: dict[str, float]
    """Figures of the initial weights, by the rival's labels; empty for random ones."""
    after: dict[str, float]
    """Figures of the new weights, by the rival's labels."""


@dataclass(frozen=True, kw_only=True)
class LearningOptions(Verb):
    """Options of every training."""

    data: Path = Path("data")
    """The folder of `ltvn dataset`; labelled pairs of the test scenes are stored in its subfolder `unseen`, walks in
    `walks`, one file per scene, made where they are missing and used by all rivals."""
    system: SystemName = DEFAULT_SYSTEM
    """Another system trains its network on its own temporal labels, on random walks. SPTM: whether two images are close
    in time. ViNG: the time from one image to the other. SoRB: the same, by an ensemble of three. HTM: which of many
    images comes soon after."""
    fresh: bool = False
    """With --system: start from random weights, as in the paper, instead of from the shipped weights; 1,500 steps are a
    good start."""
    work: FilledFolder | None = None
    """Folder for checkpoints, curves and validation figures; by default data/training, or with --system a folder below
    the walks."""
    minutes: float | None = None
    """Time for training, in minutes; by default 45, or 8 with --system."""
    steps: int | None = None
    """Train for this number of steps instead; takes longer on a slower machine, but gives the same weights."""
    processes: int | None = None
    """With --system: number of scenes that are rendered at the same time, by default two."""
    device: DeviceOption = "auto"
    seed: int = 0
    """Seed of initial weights, walks, pairs, batches and augmentation."""


@dataclass(frozen=True)
class RivalTraining:
    """The training of one system's network, written to `output`."""

    options: LearningOptions
    output: Path

    def run(self) -> RivalSummary:
        """Walk, label, train and save; raises OptionError, DatasetError, SceneError and WeightsError."""
        from ltvn_core.network.device import choose_device
        from ltvn_core.network.optimization.training_loop import train
        from ltvn_core.network.weights_file import load_weights, save_weights

        learning = self._checked()
        data = self._labelled(learning)
        plan = self._plan(learning)
        below = _below(learning)
        work = self.options.work or self.options.data / "walks" / self.options.system
        with sole_user(work):
            start, device = self._start(learning, work), choose_device(self.options.device)
            result = train(data, plan, work, start=start, device=device)
        learned = result.weights
        if below is not None:  # The file holds the added layers alone, in half precision; that is what is measured.
            learned = result.weights.with_name("added.safetensors")
            save_weights(load_weights(result.weights), learned, added_to=below)
        card = self._card(learning, data, plan, result, learned)
        fingerprint = save_weights(load_weights(learned), self.output, asdict(card), added_to=below)
        return RivalSummary(
            weights=self.output,
            fingerprint=fingerprint,
            images=card.trained_on.images,
            pairs=card.trained_on.pairs,
            steps=card.steps,
            pairs_compared=card.pairs_compared,
            minutes=card.minutes,
            before=asdict(card.before) if card.before else {},
            after=asdict(card.after),
        )

    def _checked(self) -> TemporalLearning:
        """Return how the system learns from time. Raises OptionError if it does not, or an option does not fit it."""
        learning = system_entry(self.options.system).learning
        trained = [entry.name for entry in baseline_systems()]
        if learning is None or self.options.system not in trained:
            known = ", ".join(trained)
            raise OptionError(f"{self.options.system} has no network to train; these systems have one: {known}.")
        if not (self._given_minutes > 0 and (self.options.steps is None or self.options.steps > 0)):
            raise OptionError("--minutes and --steps must be above 0; 8 minutes or 300 steps are a good start.")
        if self.options.fresh and _below(learning):
            raise OptionError(f"{self.options.system} adds layers to the shipped weights; leave --fresh out.")
        if self.output.suffix != ".safetensors":
            raise OptionError(f"--output must end in .safetensors, got {self.output}.")
        return learning

    @property
    def _given_minutes(self) -> float:
        return _MINUTES if self.options.minutes is None else self.options.minutes

    def _labelled(self, learning: TemporalLearning) -> "TrainingData":
        from ltvn_core.network.optimization.training_loop import TrainingData
        from ltvn_core.network.training_data.shards import split_shards
        from ltvn_core.simulation.scene_registry import scene_names
        from ltvn_core.training.simulated_scenes import labelled_walks
        from ltvn_core.verbs.dataset import DEFAULT_SCENE_PREFIXES

        asked = self.options
        names = [name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES)]
        folder, processes = asked.data / "walks", asked.processes or 2
        shards = labelled_walks(learning.rule, names, folder, seed=asked.seed, processes=processes)
        return TrainingData(*split_shards(shards, VALIDATION_SCENES))

    def _plan(self, learning: TemporalLearning) -> "TrainingPlan":
        from ltvn_core.network.baseline_training import baseline_training_plan

        return baseline_training_plan(
            even_distances=learning.even_distances,
            minutes=self._given_minutes,
            steps=self.options.steps,
            seed=self.options.seed,
            fresh=self.options.fresh or _below(learning) is not None,
        )

    def _start(self, learning: TemporalLearning, work: Path) -> Path | None:
        """Return the initial weights, None for random ones; layers to add are saved with them in the folder `work`."""
        from ltvn_core.network.network_families import extend_network
        from ltvn_core.network.weights_file import load_weights, save_weights

        if learning.added is None:
            return None if self.options.fresh else SHIPPED_WEIGHTS
        work.mkdir(parents=True, exist_ok=True)
        start = work / "start.safetensors"
        network = extend_network(load_weights(SHIPPED_WEIGHTS), learning.added, self.options.seed)
        save_weights(network, start, added_to=SHIPPED_WEIGHTS)
        return start

    def _card(
        self,
        learning: TemporalLearning,
        data: "TrainingData",
        plan: "TrainingPlan",
        result: "TrainingResult",
        learned: Path,
    ) -> "BaselineCard":
        from ltvn_core.network.baseline_training import BaselineCard, evaluate_baseline
        from ltvn_core.network.predictor import load_predictor
        from ltvn_core.network.training_data.shards import Shard
        from ltvn_core.network.weights_file import read_card, weights_fingerprint

        start = None if self.options.fresh else SHIPPED_WEIGHTS
        shards = [scene for scene in data.scenes if isinstance(scene, Shard)]
        asked = self.options
        length = f"--minutes {self._given_minutes:g}" if asked.steps is None else f"--steps {asked.steps}"
        command = f"ltvn train --system {asked.system} --output {self.output.name} {length}{' --fresh' * asked.fresh}"
        return BaselineCard(
            self.options.system,
            start and weights_fingerprint(start),
            read_card(start) if start and _below(learning) is None else None,
            asdict(learning.rule),
            training_data_summary(shards),
            plan,
            result.steps,
            result.pairs,
            result.seconds / 60,
            (f"{command} --seed {asked.seed}",),
            evaluate_baseline(load_predictor(start), data.validation) if start else None,
            evaluate_baseline(load_predictor(learned), data.validation),
        )


def _below(learning: TemporalLearning) -> Path | None:
    """Return the weights to which a system adds layers; None if it adds none."""
    return SHIPPED_WEIGHTS if learning.added else None
