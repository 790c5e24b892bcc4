"""`ltvn train`: trains weights on a dataset and writes a card for them; those of a rival by `rival_training`."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ltvn_core.errors import DatasetError, OptionError
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.registry import DEFAULT_SYSTEM
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
from ltvn_core.verbs.outputs import NewWeights
from ltvn_core.verbs.rival_training import LearningOptions, RivalTraining
from ltvn_core.verbs.verb import Summary

if TYPE_CHECKING:
    from ltvn_core.network.model_card import HeldOutMetrics, InferenceSpeed, ModelCard
    from ltvn_core.network.optimization.training_loop import TrainingPlan, TrainingResult
    from ltvn_core.network.training_data.shards import Shard

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
class TrainVerb(LearningOptions):
    """Train the network on a dataset, or with --system that of a rival on random walks; continues from the checkpoint
    in `work` if there is one."""

    architecture: Literal["aligned-pairs", "stacked"] = "aligned-pairs"
    """The network: matches and aligns tokens of the two images, or the paper's plain network on both images stacked."""
    output: NewWeights | None = None
    """The weights to write; a card is written beside them."""
    bfloat16: bool = False
    """Train in mixed precision: faster on a graphics card or processor made for bfloat16, and other weights."""
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
            return RivalTraining(self, output).run()
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
    device = choose_device(options.device)
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
        minutes=_MINUTES if options.minutes is None else options.minutes,
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
            + (f"--minutes {plan.minutes:g}" if options.steps is None else f"--steps {options.steps}")
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
