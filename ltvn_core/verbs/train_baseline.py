"""`ltvn train --system NAME`: trains our network on the labels of a rival, on random walks, for a fair comparison.

Started from the shipped weights, it is the strongest rival that we can train; started from random weights, it is the
rival of the paper. Some rivals add layers to the shipped weights; then only these layers are trained and saved.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError
from ltvn_core.network.baseline_training import BaselineCard, baseline_training_plan, evaluate_baseline
from ltvn_core.network.network_families import extend_network
from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, TrainingResult, train
from ltvn_core.network.predictor import load_predictor
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.training_data.shards import Shard, split_shards
from ltvn_core.network.weights_file import load_weights, read_card, save_weights, weights_fingerprint
from ltvn_core.simulation.scene_registry import scene_names
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.entry import TemporalLearning
from ltvn_core.systems.registry import baseline_systems, system_entry
from ltvn_core.training.held_out_scenes import VALIDATION_SCENES, training_data_summary
from ltvn_core.training.simulated_scenes import labelled_walks
from ltvn_core.verbs.dataset import DEFAULT_SCENE_PREFIXES

if TYPE_CHECKING:
    from ltvn_core.verbs.train import TrainVerb

_MINUTES = 8.0
"""Time for training where no option gives it, in minutes."""


@dataclass(frozen=True)
class BaselineSummary:
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


def train_baseline(options: "TrainVerb", output: Path) -> BaselineSummary:
    """Walk, label, train and save; raises OptionError, DatasetError, SceneError and WeightsError."""
    _check_options(options, output)
    data = _data(options)
    plan = _plan(options)
    work = options.work or _walks(options) / options.system
    with sole_user(work):
        result = train(data, plan, work, start=_start(options, work))
    learned = _learned(options, result.weights)
    card = _card(options, output, data, plan, result, learned)
    fingerprint = save_weights(load_weights(learned), output, asdict(card), added_to=_below(options))
    return BaselineSummary(
        weights=output,
        fingerprint=fingerprint,
        images=card.trained_on.images,
        pairs=card.trained_on.pairs,
        steps=card.steps,
        pairs_compared=card.pairs_compared,
        minutes=card.minutes,
        before=asdict(card.before) if card.before else {},
        after=asdict(card.after),
    )


def _check_options(options: "TrainVerb", output: Path) -> None:
    _temporal_learning(options.system)
    if not (_minutes(options) > 0 and (options.steps is None or options.steps > 0)):
        raise OptionError("--minutes and --steps must be above 0; 8 minutes or 300 steps are a good start.")
    if options.fresh and _below(options):
        raise OptionError(f"{options.system} adds layers to the shipped weights; leave --fresh out.")
    if output.suffix != ".safetensors":
        raise OptionError(f"--output must end in .safetensors, got {output}.")


def _below(options: "TrainVerb") -> Path | None:
    """Return the weights to which the rival adds layers; None if it adds none."""
    return SHIPPED_WEIGHTS if _temporal_learning(options.system).added else None


def _start(options: "TrainVerb", work: Path) -> Path | None:
    """Return the initial weights, None for random ones; layers to add are saved with them in the folder `work`."""
    if (added := _temporal_learning(options.system).added) is None:
        return None if options.fresh else SHIPPED_WEIGHTS
    work.mkdir(parents=True, exist_ok=True)
    start = work / "start.safetensors"
    save_weights(extend_network(load_weights(SHIPPED_WEIGHTS), added, options.seed), start, added_to=SHIPPED_WEIGHTS)
    return start


def _learned(options: "TrainVerb", weights: Path) -> Path:
    """Return the file of the new weights as it will be saved; if layers were added, it holds only these, in half
    precision."""
    if _below(options) is None:
        return weights
    added = weights.with_name("added.safetensors")
    save_weights(load_weights(weights), added, added_to=_below(options))
    return added


def _walks(options: "TrainVerb") -> Path:
    return options.data / "walks"


def _minutes(options: "TrainVerb") -> float:
    return _MINUTES if options.minutes is None else options.minutes


def _length(options: "TrainVerb") -> str:
    length = f"--minutes {_minutes(options):g}" if options.steps is None else f"--steps {options.steps}"
    return length + " --fresh" * options.fresh


def _data(options: "TrainVerb") -> TrainingData:
    names = [name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES)]
    shards = labelled_walks(
        _temporal_learning(options.system).rule,
        names,
        _walks(options),
        seed=options.seed,
        processes=options.processes or 2,
    )
    return TrainingData(*split_shards(shards, VALIDATION_SCENES))


def _plan(options: "TrainVerb") -> TrainingPlan:
    return baseline_training_plan(
        even_distances=_temporal_learning(options.system).even_distances,
        minutes=_minutes(options),
        steps=options.steps,
        seed=options.seed,
        fresh=options.fresh or _below(options) is not None,
    )


def _card(
    options: "TrainVerb", output: Path, data: TrainingData, plan: TrainingPlan, result: TrainingResult, learned: Path
) -> BaselineCard:
    start = None if options.fresh else SHIPPED_WEIGHTS
    shards = [scene for scene in data.scenes if isinstance(scene, Shard)]
    return BaselineCard(
        options.system,
        start and weights_fingerprint(start),
        read_card(start) if start and _below(options) is None else None,
        asdict(_temporal_learning(options.system).rule),
        training_data_summary(shards),
        plan,
        result.steps,
        result.pairs,
        result.seconds / 60,
        (f"ltvn train --system {options.system} --output {output.name} {_length(options)} --seed {options.seed}",),
        evaluate_baseline(load_predictor(start), data.validation) if start else None,
        evaluate_baseline(load_predictor(learned), data.validation),
    )


def _temporal_learning(system: str) -> TemporalLearning:
    """Return the settings with which a system learns from time; raises OptionError if it does not."""
    learning = system_entry(system).learning
    trained = [entry.name for entry in baseline_systems()]
    if learning is not None and system in trained:
        return learning
    raise OptionError(
        f"{system} has no network that can be trained for a given time; these have one: {', '.join(trained)}."
    )
