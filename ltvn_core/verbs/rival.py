"""`ltvn rival`: our network learns the labels of SPTM or ViNG on random walks, for a comparison under equal terms.

From the shipped weights it is as good a rival as we can make; from nothing it is the rival of the paper.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.lessons.unseen import VALIDATION
from ltvn_core.lessons.walks import labelled_walks
from ltvn_core.verbs.dataset import FAMILIES
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.model.rival_card import RivalCard
    from ltvn_core.model.training import TrainingData, TrainingPlan, TrainingResult


@dataclass(frozen=True)
class RivalTrained:
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
class Rival(Verb):
    """Train a rival's network: the shipped weights, or new ones, learn its labels of time on random walks."""

    rival: Positional[Literal["sptm", "ving"]]
    """SPTM: close in time or not. ViNG: how long it takes to get there."""
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
        from ltvn_core.model.training import train
        from ltvn_core.model.weights import load_weights, save_weights

        self._check_options()
        data, plan = self._data(), self._plan()
        work = self.work or self.data / self.rival
        result = train(data, plan, work, start=self._start())
        card = self._card(data, plan, result)
        fingerprint = save_weights(load_weights(result.weights), self.output, asdict(card))
        size = (card.trained_on.images, card.trained_on.pairs)
        figures = (asdict(card.before) if card.before else {}, asdict(card.after))
        return RivalTrained(self.output, fingerprint, *size, card.steps, card.pairs_compared, card.minutes, *figures)

    def _check_options(self) -> None:
        if not (self.minutes > 0 and (self.steps is None or self.steps > 0)):
            raise OptionError("--minutes and --steps must be above 0; 8 minutes or 300 steps are a good start.")
        if self.output.suffix != ".safetensors" or self.output.exists():
            raise OptionError(f"--output must be a new file that ends in .safetensors, got {self.output}.")

    def _start(self) -> Path | None:
        from ltvn_core.model.weights import SHIPPED

        return None if self.fresh else SHIPPED

    def _length(self) -> str:
        length = f"--minutes {self.minutes:g}" if self.steps is None else f"--steps {self.steps}"
        return length + " --fresh" * self.fresh

    def _data(self) -> "TrainingData":
        from ltvn_core.model.training import TrainingData
        from ltvn_core.sim.scenes import scene_names

        names = [name for name in scene_names() if name.startswith(FAMILIES)]
        shards = labelled_walks(self.rival, names, self.data, seed=self.seed, processes=self.processes)
        learned = [shard for shard in shards if shard.name not in VALIDATION]
        return TrainingData(learned, [shard for shard in shards if shard.name in VALIDATION])

    def _plan(self) -> "TrainingPlan":
        from ltvn_core.model.rival_plan import rival_training

        return rival_training(self.rival, minutes=self.minutes, steps=self.steps, seed=self.seed, fresh=self.fresh)

    def _card(self, data: "TrainingData", plan: "TrainingPlan", result: "TrainingResult") -> "RivalCard":
        from ltvn_core.data.shards import Shard
        from ltvn_core.data.temporal_rules import RULES
        from ltvn_core.model.card import TrainedOn
        from ltvn_core.model.predictor import load_predictor
        from ltvn_core.model.rival_card import RivalCard, assess_rival
        from ltvn_core.model.weights import read_card, weights_fingerprint

        start = self._start()
        shards = [scene for scene in data.scenes if isinstance(scene, Shard)]
        return RivalCard(
            self.rival,
            start and weights_fingerprint(start),
            start and read_card(start),
            asdict(RULES[self.rival]),
            TrainedOn(
                tuple(shard.name for shard in shards),
                VALIDATION,
                sum(len(shard.rgb) for shard in shards),
                sum(len(shard.sources) for shard in shards),
                shards[0].recipe,
            ),
            plan,
            result.steps,
            result.pairs,
            result.seconds / 60,
            (f"ltvn rival {self.rival} --output {self.output.name} {self._length()} --seed {self.seed}",),
            assess_rival(load_predictor(start), data.validation) if start else None,
            assess_rival(load_predictor(result.weights), data.validation),
        )
