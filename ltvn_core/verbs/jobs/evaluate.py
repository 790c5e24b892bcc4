"""`ltvn evaluate`: the paper's protocol, for LTVN and its rivals."""

import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from joblib import delayed
from tqdm import tqdm

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.metrics import compute_metrics
from ltvn_core.evaluation.perturbations import chosen_perturbations
from ltvn_core.evaluation.plans import RunFiles, RunPlan, sole_evaluation
from ltvn_core.evaluation.protocol import EvaluationProtocol, protocol_under
from ltvn_core.evaluation.results import Run
from ltvn_core.evaluation.runner import record_failures, run_plans, share_of, work_in
from ltvn_core.evaluation.workers import Part, Workers, workers
from ltvn_core.predictors.choice import ImageSource
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body_selection import choose_body
from ltvn_core.simulation.scene_registry import check_scene
from ltvn_core.verbs.evaluate import EvaluateVerb, ProtocolOptions
from ltvn_core.verbs.jobs.evaluation_progress import PartSummary, progress_on_bar


@dataclass(frozen=True)
class EvaluateSummary:
    """Results of the episodes of all scenes and seeds."""

    scenes: tuple[str, ...]
    method: str
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    episodes: int
    """Number of episodes of all scenes and seeds."""
    success_rate: float
    success_low: float
    """Lower limit of the 95 % confidence interval of the success rate."""
    success_high: float
    spl: float
    """Success weighted by path length."""
    collisions_per_episode: float
    steps_per_episode: float
    """Mean number of control steps of 0.1 s."""
    nodes: float
    """Mean number of nodes over the maps."""
    edges: float
    spurious_edges: float
    """Mean number of false edges, by the simulator's ground truth."""
    failures: dict[str, int]
    """Number of failed episodes by cause."""
    images_without_depth: int
    """Number of images of all mapping drives in which the camera found no depth; the maps are built without them."""
    folder: Path
    """Folder of drives, weights, maps and results; a second call of the verb continues from them."""
    wall_s: float


def _protocol(options: ProtocolOptions, episodes: int) -> EvaluationProtocol:
    """Return the settings of the test. Raises OptionError."""
    # The body is chosen here and not by the workers, which may be machines with other libraries.
    body = choose_body(options.body)
    plain = EvaluationProtocol(options.loops, options.goals, episodes, step_limit=options.step_limit, body=body)
    return protocol_under(plain, options.conditions)


def run_plans_of(
    options: ProtocolOptions, system: str, episodes: int, perturbations: tuple[str, ...] = ()
) -> list[RunPlan]:
    """Return a plan for each scene and seed. Raises OptionError and SceneError."""
    if (
        not options.scene
        or not options.seed
        or len({*options.scene}) < len(options.scene)
        or len({*options.seed}) < len(options.seed)
    ):
        raise OptionError("--scene and --seed need at least one value, and no value twice.")
    for scene in options.scene:
        check_scene(scene)  # Check all scenes before weights are fine-tuned for one of them.
    protocol = _protocol(options, episodes)
    predictor = ImageSource(camera=LOCOBOT.camera).choose(options.predictor).name
    return [
        RunPlan(
            scene=scene,
            seed=seed,
            system=system,
            preset=options.preset,
            parts_off=tuple(sorted(options.without)),
            perturbations=perturbations,
            conditions=tuple(sorted(set(options.conditions))),
            predictor=predictor,
            weights=options.weights,
            finetune_steps=options.finetune_steps,
            protocol=protocol,
        )
        for scene in options.scene
        for seed in options.seed
    ]


def run_on_bar(
    options: ProtocolOptions,
    plans: Sequence[RunPlan],
    *,
    title: str,
    unit: str,
    share_name: str = "",
    then: Callable[[Workers, Sequence[Run]], object] = lambda parallel, runs: None,
) -> tuple[list[Run], float] | PartSummary:
    """Run some plans under a progress bar, alone in their folders.

    Returns the finished runs and the time in seconds, or the summary of a part if other parts are unfinished. If all
    are finished, calls `then` first. Raises as `run_plans` does.
    """
    started = time.monotonic()
    part = Part.parse(options.part)
    share = share_of(plans, part)
    with (
        sole_evaluation(plans, f"{share_name}{part.label}", options.folder),
        workers(options.processes, options.cluster, options.folder) as parallel,
        tqdm(total=work_in(share), desc=title, unit=unit) as bar,
    ):
        progress = progress_on_bar(bar, len(share))
        runs = run_plans(plans, options.folder, command=command(), parallel=parallel, progress=progress, part=part)
        if len(runs) < len(plans):
            seconds = time.monotonic() - started
            return PartSummary(str(part), bar.n, len(plans), len(runs), options.folder, seconds)
        then(parallel, runs)
    return runs, time.monotonic() - started


def evaluate(options: EvaluateVerb) -> EvaluateSummary | PartSummary:
    """Run all episodes that have no result yet. Raises OptionError, SceneError, WeightsError, MapError and
    RecordingError."""
    if options.record_failures < 0:
        raise OptionError(f"--record-failures must be 0 or more, got {options.record_failures}.")
    plans = run_plans_of(options, options.system, options.episodes, chosen_perturbations(options.perturb))

    def record(parallel: Workers, runs: Sequence[Run]) -> None:
        if options.record_failures:
            again = [(plan, RunFiles.of(plan, options.folder), run) for plan, run in zip(plans, runs, strict=True)]
            list(parallel(delayed(record_failures)(*each, options.record_failures) for each in again))

    found = run_on_bar(options, plans, title="evaluate", unit="episode", then=record)
    return found if isinstance(found, PartSummary) else _summary(options, *found)


def _summary(options: EvaluateVerb, runs: Sequence[Run], wall_s: float) -> EvaluateSummary:
    trials = [known for run in runs for known in run.maps]
    found = compute_metrics(trials)
    return EvaluateSummary(
        scenes=options.scene,
        method=options.system,
        preset=options.preset,
        without=options.without,
        seeds=options.seed,
        episodes=found.episodes,
        success_rate=found.success_rate.mean,
        success_low=found.success_rate.low,
        success_high=found.success_rate.high,
        spl=found.spl.mean,
        collisions_per_episode=found.collisions_per_episode.mean,
        steps_per_episode=found.steps_per_episode.mean,
        nodes=found.nodes,
        edges=found.edges,
        spurious_edges=found.spurious_edges,
        failures=found.failures,
        images_without_depth=sum(trial.without_depth for trial in trials),
        folder=options.folder,
        wall_s=wall_s,
    )


def command() -> str:
    """Return the current command line, with file names instead of absolute paths, because results are published."""
    return shlex.join(["ltvn", *map(_without_folders, sys.argv[1:])])


def _without_folders(argument: str) -> str:
    option, assigned, value = argument.rpartition("=")
    return f"{option}{assigned}{Path(value).name}" if Path(value).is_absolute() else argument
