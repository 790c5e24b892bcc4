"""`ltvn train`: trains weights on a dataset, or for a rival on random walks, and writes a card for them."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ltvn_core.errors import DatasetError, OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.entry import TemporalLearning
from ltvn_core.systems.registry import DEFAULT_SYSTEM, baseline_systems, system_entry
from ltvn_core.training.held_out_scenes import (
    CLUSTERS_PER_SCENE,
    IMAGES_PER_DRIVE,
    TEST_SCENES,
    VALIDATION_SCENES,
    NetworkMetrics,
    drives,
    figures,
    measure_network,
    training_data_summary,
)
from ltvn_core.verbs.option_types import SystemName
from ltvn_core.verbs.outputs import FilledFolder, NewWeights
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.baseline_training import BaselineCard
    from ltvn_core.network.model_card import HeldOutMetrics, InferenceSpeed, ModelCard
    from ltvn_core.network.optimization.training_loop import TrainingData, TrainingPlan, TrainingResult
    from ltvn_core.network.training_data.shards import Shard

_BASELINE_MINUTES = 8.0
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


_WORK = Path("data/training")
_MINUTES = 45.0
_VALIDATION_DRIVE = 220
"""Number of images of the drive through each validation scene."""
_SHORT_DRIVE = 60
"""Number of images of that drive in a short training, where comparing more would take longer than training itself."""
_FEW_STEPS = 1000
"""Number of steps below which a training is short; it also compares a fifth of the pairs."""


@dataclass(frozen=True)
class TrainSummary:
    """New weights and their figures in scenes that training has not seen."""

    weights: Path
    steps: int
    pairs_compared: int
    minutes: float
    parameters: int
    encode_ms: float
    """Time to encode an image on this machine, in milliseconds."""
    pair_ms: float
    """Time to compare a pair of encoded images on this machine, in milliseconds."""
    figures: NetworkMetrics


@dataclass(frozen=True)
class NetworkEvaluationSummary(NetworkMetrics):
    """Figures of weights, and of the paper's plain network beside them."""

    stacked: NetworkMetrics | None
    """Figures of the weights in --stacked; None without this option."""


@dataclass(frozen=True, kw_only=True)
class TrainVerb(Verb):
    """Train the network on a dataset, or with --system that of a rival on random walks; continues from the checkpoint
    in `work` if there is one."""

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
    architecture: Literal["aligned-pairs", "stacked"] = "aligned-pairs"
    """The network: matches and aligns tokens of the two images, or the paper's plain network on both images stacked."""
    output: NewWeights | None = None
    """The weights to write; a card is written beside them."""
    work: FilledFolder | None = None
    """Folder for checkpoints, curves and validation figures; by default data/training, or with --system a folder below
    the walks."""
    minutes: float | None = None
    """Time for training, in minutes; by default 45, or 8 with --system."""
    steps: int | None = None
    """Train for this number of steps instead; takes longer on a slower machine, but gives the same weights."""
    processes: int | None = None
    """With --system: number of scenes that are rendered at the same time, by default two."""
    bfloat16: bool = False
    """Train in mixed precision: faster on a graphics card or processor made for bfloat16, and other weights."""
    seed: int = 0
    """Seed of initial weights, walks, pairs, batches and augmentation."""
    evaluate: bool = False
    """Do not train; measure existing weights."""
    weights: Path | None = None
    """With --evaluate: the weights to measure instead of the shipped ones."""
    stacked: Path | None = None
    """With --evaluate: weights of a plain network, made with --architecture stacked, to measure for comparison."""
    scenes: tuple[str, ...] = TEST_SCENES
    """With --evaluate: the scenes to measure on, by name or by the path of a mesh."""
    clusters: int = CLUSTERS_PER_SCENE
    """With --evaluate: number of clusters of labelled pairs in each scene."""
    images: int = IMAGES_PER_DRIVE
    """With --evaluate: number of images of the drive through each scene."""

    def run(self) -> Summary:
        """Train, measure and save; raises OptionError, DatasetError, SceneError and WeightsError."""

        _check(self)
        if self.evaluate:
            return _evaluate(self)
        output = _checked_output(self)
        if self.system != DEFAULT_SYSTEM:
            return train_baseline(self, output)
        work = self.work or _WORK
        with sole_user(output), sole_user(work):
            return _trained(self, output, work)


def _check(options: TrainVerb) -> None:
    is_baseline = options.system != DEFAULT_SYSTEM
    if options.fresh and not is_baseline:
        raise OptionError("--fresh needs --system; the network of ltvn always starts from random weights.")
    if options.processes and not is_baseline:
        raise OptionError("--processes needs --system; the network of ltvn is trained by one process.")
    if is_baseline and (options.evaluate or options.bfloat16 or options.architecture != "aligned-pairs"):
        raise OptionError(
            "--evaluate, --architecture and --bfloat16 are for the network of ltvn; leave them or --system out."
        )


def _trained(options: TrainVerb, output: Path, work: Path) -> TrainSummary:
    from ltvn_core.network.device import choose_device
    from ltvn_core.network.model_card import measure_speed
    from ltvn_core.network.optimization.training_loop import TrainingData, train
    from ltvn_core.network.weights_file import load_weights, save_weights

    plan = _plan(options)
    device = choose_device()
    learned, validation = read_shards(options.data)
    images = _SHORT_DRIVE if _is_short(options) else _VALIDATION_DRIVE
    seen = drives([shard.name for shard in validation], images=images)
    result = train(TrainingData(learned, validation, seen), plan, work, device=device)
    network = load_weights(result.weights)
    measured = _measure(options, result.weights)
    card = _card(options, output, learned, plan, result, measure_speed(network), measured)
    save_weights(network, output, asdict(card))
    speed = card.speed
    found = figures(output, measured)
    times = (speed.parameters, speed.encode_ms, speed.pair_ms)
    return TrainSummary(output, card.steps, card.pairs_compared, card.minutes, *times, found)


def _plan(options: TrainVerb) -> "TrainingPlan":
    from ltvn_core.network.network_families import default_architecture
    from ltvn_core.network.optimization.trainer import Hyperparameters
    from ltvn_core.network.optimization.training_loop import TrainingPlan

    plan = TrainingPlan(
        Hyperparameters(seed=options.seed),
        default_architecture(options.architecture),
        minutes=_minutes(options),
        bfloat16=options.bfloat16,
    )
    if options.architecture == "stacked":  # It runs on the pixels of every pair: validate on fewer.
        plan = replace(plan, validation_pairs=plan.validation_pairs // 4, validation_far=plan.validation_far // 4)
    if options.steps is None:
        return plan
    looks = min(max(options.steps // 100, 1), plan.validations)
    if _is_short(options):
        plan = replace(plan, validation_pairs=plan.validation_pairs // 5, validation_far=plan.validation_far // 5)
    return replace(plan, minutes=None, steps=options.steps, validations=looks, minings=2 * looks)


def _is_short(options: TrainVerb) -> bool:
    """Return whether this is a trial of few steps, in which a full validation would take longer than the training."""
    return options.steps is not None and options.steps < _FEW_STEPS


def _evaluate(options: TrainVerb) -> NetworkEvaluationSummary:
    def judge(weights: Path) -> NetworkMetrics:
        return figures(weights, _measure(options, weights))

    found = judge(options.weights or SHIPPED_WEIGHTS)
    stacked = None if options.stacked is None else judge(options.stacked)
    return NetworkEvaluationSummary(**vars(found), stacked=stacked)


def _measure(options: TrainVerb, weights: Path) -> "HeldOutMetrics":
    folder = options.data / "unseen"
    return measure_network(weights, folder, options.scenes, clusters=options.clusters, images=options.images)


def _minutes(options: TrainVerb) -> float:
    return _MINUTES if options.minutes is None else options.minutes


def _checked_output(options: TrainVerb) -> Path:
    """Return the output file. Raises OptionError if none is given or the file exists."""
    if options.output is None:
        raise OptionError("--output is missing: name the weights to write, for instance --output my.safetensors.")
    if options.output.exists():
        raise OptionError(f"{options.output} exists; nothing is overwritten. Name another --output or move it away.")
    return options.output


def _card(
    options: TrainVerb,
    output: Path,
    learned: "list[Shard]",
    plan: "TrainingPlan",
    result: "TrainingResult",
    speed: "InferenceSpeed",
    measured: "HeldOutMetrics",
) -> "ModelCard":
    from ltvn_core.network.model_card import ModelCard

    return ModelCard(
        training_data_summary(learned),
        plan,
        result.steps,
        result.pairs,
        result.seconds / 60,
        (
            f"ltvn dataset --folder data --clusters {len(set(learned[0].group.tolist()))}",
            f"ltvn train --data data --architecture {options.architecture} --output {output.name} "
            + (f"--minutes {_minutes(options):g}" if options.steps is None else f"--steps {options.steps}")
            + f" --seed {options.seed}"
            + (" --bfloat16" if options.bfloat16 else ""),
        ),
        speed,
        measured,
    )


def read_shards(folder: Path) -> "tuple[list[Shard], list[Shard]]":
    """Return a dataset's shards for training and for validation. Raises DatasetError if either is missing."""
    from ltvn_core.network.training_data.shards import dataset_shards, read_shard, split_shards

    shards = [read_shard(path) for path in dataset_shards(folder)]
    learned, validation = split_shards((shard for shard in shards if shard.name not in TEST_SCENES), VALIDATION_SCENES)
    if not learned or not validation:
        raise DatasetError(
            f"{folder}: needs shards of scenes to learn from and of {', '.join(VALIDATION_SCENES)}, found "
            f"{', '.join(shard.name for shard in shards) or 'none'}; run `ltvn dataset --folder {folder}`."
        )
    return learned, validation


def train_baseline(options: TrainVerb, output: Path) -> BaselineSummary:
    """Walk, label, train and save; raises OptionError, DatasetError, SceneError and WeightsError."""
    from ltvn_core.network.optimization.training_loop import train
    from ltvn_core.network.weights_file import load_weights, save_weights

    _check_options(options, output)
    data = _data(options)
    plan = _baseline_plan(options)
    work = options.work or _walks(options) / options.system
    with sole_user(work):
        result = train(data, plan, work, start=_start(options, work))
    learned = _learned(options, result.weights)
    card = _baseline_card(options, output, data, plan, result, learned)
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


def _check_options(options: TrainVerb, output: Path) -> None:
    _temporal_learning(options.system)
    if not (_baseline_minutes(options) > 0 and (options.steps is None or options.steps > 0)):
        raise OptionError("--minutes and --steps must be above 0; 8 minutes or 300 steps are a good start.")
    if options.fresh and _below(options):
        raise OptionError(f"{options.system} adds layers to the shipped weights; leave --fresh out.")
    if output.suffix != ".safetensors":
        raise OptionError(f"--output must end in .safetensors, got {output}.")


def _below(options: TrainVerb) -> Path | None:
    """Return the weights to which the rival adds layers; None if it adds none."""
    return SHIPPED_WEIGHTS if _temporal_learning(options.system).added else None


def _start(options: TrainVerb, work: Path) -> Path | None:
    """Return the initial weights, None for random ones; layers to add are saved with them in the folder `work`."""
    from ltvn_core.network.network_families import extend_network
    from ltvn_core.network.weights_file import load_weights, save_weights

    if (added := _temporal_learning(options.system).added) is None:
        return None if options.fresh else SHIPPED_WEIGHTS
    work.mkdir(parents=True, exist_ok=True)
    start = work / "start.safetensors"
    save_weights(extend_network(load_weights(SHIPPED_WEIGHTS), added, options.seed), start, added_to=SHIPPED_WEIGHTS)
    return start


def _learned(options: TrainVerb, weights: Path) -> Path:
    """Return the file of the new weights as it will be saved; if layers were added, it holds only these, in half
    precision."""
    from ltvn_core.network.weights_file import load_weights, save_weights

    if _below(options) is None:
        return weights
    added = weights.with_name("added.safetensors")
    save_weights(load_weights(weights), added, added_to=_below(options))
    return added


def _walks(options: TrainVerb) -> Path:
    return options.data / "walks"


def _baseline_minutes(options: TrainVerb) -> float:
    return _BASELINE_MINUTES if options.minutes is None else options.minutes


def _length(options: TrainVerb) -> str:
    length = f"--minutes {_baseline_minutes(options):g}" if options.steps is None else f"--steps {options.steps}"
    return length + " --fresh" * options.fresh


def _data(options: TrainVerb) -> "TrainingData":
    from ltvn_core.network.optimization.training_loop import TrainingData
    from ltvn_core.network.training_data.shards import split_shards
    from ltvn_core.simulation.scene_registry import scene_names
    from ltvn_core.training.simulated_scenes import labelled_walks
    from ltvn_core.verbs.dataset import DEFAULT_SCENE_PREFIXES

    names = [name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES)]
    shards = labelled_walks(
        _temporal_learning(options.system).rule,
        names,
        _walks(options),
        seed=options.seed,
        processes=options.processes or 2,
    )
    return TrainingData(*split_shards(shards, VALIDATION_SCENES))


def _baseline_plan(options: TrainVerb) -> "TrainingPlan":
    from ltvn_core.network.baseline_training import baseline_training_plan

    return baseline_training_plan(
        even_distances=_temporal_learning(options.system).even_distances,
        minutes=_baseline_minutes(options),
        steps=options.steps,
        seed=options.seed,
        fresh=options.fresh or _below(options) is not None,
    )


def _baseline_card(
    options: TrainVerb,
    output: Path,
    data: "TrainingData",
    plan: "TrainingPlan",
    result: "TrainingResult",
    learned: Path,
) -> "BaselineCard":
    from ltvn_core.network.baseline_training import BaselineCard, evaluate_baseline
    from ltvn_core.network.predictor import load_predictor
    from ltvn_core.network.training_data.shards import Shard
    from ltvn_core.network.weights_file import read_card, weights_fingerprint

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
