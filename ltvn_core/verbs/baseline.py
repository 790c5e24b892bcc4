"""`ltvn baseline`: our network learns the labels of a rival on random walks, for a comparison under equal terms.

From the shipped weights it is as good a rival as we can make; from nothing it is the rival of the paper. Some rivals
add layers of their own to the shipped weights, and only those learn and are written.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.systems.entry import TemporalLearning
from ltvn_core.systems.registry import baseline_systems, system_entry
from ltvn_core.training.held_out_scenes import VALIDATION_SCENES
from ltvn_core.training.labelled_walks import labelled_walks
from ltvn_core.verbs.dataset import DEFAULT_SCENE_PREFIXES
from ltvn_core.verbs.system_option import SystemName
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.baseline_training import BaselineCard
    from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, TrainingResult


@dataclass(frozen=True)
class BaselineSummary:
    """New weights, and how well they know the rival's labels in scenes that were not learned from."""

    weights: Path
    fingerprint: str
    images: int
    pairs: int
    """Labelled pairs."""
    steps: int
    pairs_compared: int
    minutes: float
    before: dict[str, float]
    """Figures of the weights it started from, if there were any,"""
    after: dict[str, float]
    """and of the new ones, by the rival's labels."""


@dataclass(frozen=True, kw_only=True)
class BaselineVerb(Verb):
    """Train a rival's network: the shipped weights, or new ones, learn its labels of time on random walks."""

    baseline: Positional[SystemName]
    """SPTM: close in time or not. ViNG: how long it takes to get there. SoRB: the same, by three judges. HTM: which of
    many images comes soon after."""
    output: Path
    """The weights to write, with a card beside them; must not exist yet."""
    data: Path = Path("data/walks")
    """Where the walks lie, one file per scene; missing ones are made, the same for both rivals."""
    work: Path | None = None
    """Where checkpoints and curves go; a folder below the walks unless named."""
    minutes: float = 8.0
    """How long to train, in one process,"""
    steps: int | None = None
    """or for how many steps of about 200 pairs, which gives the same weights on a slower machine."""
    fresh: bool = False
    """Learn from nothing, as in the paper, instead of from the shipped weights; 1,500 steps are a good start."""
    processes: int = 2
    """Scenes that are rendered at the same time."""
    seed: int = 0
    """Draws walks, pairs, batches and augmentation."""

    def run(self) -> Summary:
        """Walk, label, train and save; raises OptionError, DatasetError, SceneError and WeightsError."""
        from ltvn_core.network.optimization.training_loop import train
        from ltvn_core.network.weights_file import load_weights, save_weights

        self._check_options()
        data, plan = self._data(), self._plan()
        work = self.work or self.data / self.baseline
        result = train(data, plan, work, start=self._start(work))
        learned = self._learned(result.weights)
        card = self._card(data, plan, result, learned)
        fingerprint = save_weights(load_weights(learned), self.output, asdict(card), added_to=self._below)
        return BaselineSummary(
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

    def _check_options(self) -> None:
        _temporal_learning(self.baseline)
        if not (self.minutes > 0 and (self.steps is None or self.steps > 0)):
            raise OptionError("--minutes and --steps must be above 0; 8 minutes or 300 steps are a good start.")
        if self.fresh and self._below:
            raise OptionError(f"{self.baseline} adds layers to the shipped weights; leave --fresh out.")
        if self.output.suffix != ".safetensors" or self.output.exists():
            raise OptionError(f"--output must be a new file that ends in .safetensors, got {self.output}.")

    @property
    def _below(self) -> Path | None:
        """The weights that the rival adds layers to, if it does."""
        return SHIPPED_WEIGHTS if _temporal_learning(self.baseline).added else None

    def _start(self, work: Path) -> Path | None:
        """Return the weights to start from, those with new layers in the folder."""
        from ltvn_core.network.network_families import extend_network
        from ltvn_core.network.weights_file import load_weights, save_weights

        if (added := _temporal_learning(self.baseline).added) is None:
            return None if self.fresh else SHIPPED_WEIGHTS
        work.mkdir(parents=True, exist_ok=True)
        start = work / "start.safetensors"
        save_weights(extend_network(load_weights(SHIPPED_WEIGHTS), added, self.seed), start, added_to=SHIPPED_WEIGHTS)
        return start

    def _learned(self, weights: Path) -> Path:
        """Return new weights as they will be written: of added layers alone, and these in half precision."""
        from ltvn_core.network.weights_file import load_weights, save_weights

        if self._below is None:
            return weights
        added = weights.with_name("added.safetensors")
        save_weights(load_weights(weights), added, added_to=self._below)
        return added

    def _length(self) -> str:
        length = f"--minutes {self.minutes:g}" if self.steps is None else f"--steps {self.steps}"
        return length + " --fresh" * self.fresh

    def _data(self) -> "TrainingData":
        from ltvn_core.network.optimization.training_loop import TrainingData
        from ltvn_core.simulation.scene_registry import scene_names
        from ltvn_core.training_data.shards import split_shards

        names = [name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES)]
        shards = labelled_walks(
            _temporal_learning(self.baseline).rule, names, self.data, seed=self.seed, processes=self.processes
        )
        return TrainingData(*split_shards(shards, VALIDATION_SCENES))

    def _plan(self) -> "TrainingPlan":
        from ltvn_core.network.baseline_training import baseline_training_plan

        return baseline_training_plan(
            even_distances=_temporal_learning(self.baseline).even_distances,
            minutes=self.minutes,
            steps=self.steps,
            seed=self.seed,
            fresh=self.fresh or self._below is not None,
        )

    def _card(
        self, data: "TrainingData", plan: "TrainingPlan", result: "TrainingResult", learned: Path
    ) -> "BaselineCard":
        from ltvn_core.network.baseline_training import BaselineCard, evaluate_baseline
        from ltvn_core.network.model_card import TrainingDataSummary
        from ltvn_core.network.predictor import load_predictor
        from ltvn_core.network.weights_file import read_card, weights_fingerprint
        from ltvn_core.training_data.shards import Shard

        start = None if self.fresh else SHIPPED_WEIGHTS
        shards = [scene for scene in data.scenes if isinstance(scene, Shard)]
        return BaselineCard(
            self.baseline,
            start and weights_fingerprint(start),
            read_card(start) if start and self._below is None else None,
            asdict(_temporal_learning(self.baseline).rule),
            TrainingDataSummary(
                tuple(shard.name for shard in shards),
                VALIDATION_SCENES,
                sum(len(shard.rgb) for shard in shards),
                sum(len(shard.sources) for shard in shards),
                shards[0].recipe,
            ),
            plan,
            result.steps,
            result.pairs,
            result.seconds / 60,
            (f"ltvn baseline {self.baseline} --output {self.output.name} {self._length()} --seed {self.seed}",),
            evaluate_baseline(load_predictor(start), data.validation) if start else None,
            evaluate_baseline(load_predictor(learned), data.validation),
        )


def _temporal_learning(system: str) -> TemporalLearning:
    """Return how a system learns by time; raises OptionError for one that does not."""
    learning = system_entry(system).learning
    trained = [entry.name for entry in baseline_systems()]
    if learning is not None and system in trained:
        return learning
    raise OptionError(
        f"{system} has no network of its own that learns by time alone; those that have are: {', '.join(trained)}."
    )
