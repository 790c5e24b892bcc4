"""`ltvn evaluate`: the paper's protocol, for LTVN and its rivals."""

import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NoReturn

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.condition_names import ConditionName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.option_types import AUTO, DeviceOption, PredictorName, SystemName
from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from tqdm import tqdm

    from ltvn_core.evaluation.plans import RunPlan
    from ltvn_core.evaluation.results import Run
    from ltvn_core.evaluation.runner import Progress


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


@dataclass(frozen=True)
class PartSummary:
    """Results of one part of a test, while other parts are unfinished."""

    part: str
    done: int
    """Number of episodes, queries or scenes in this part."""
    tests: int
    """Number of tests in all parts: one for each scene, seed and maintenance."""
    finished: int
    """Number of tests in all parts that are complete."""
    folder: Path
    """Folder that all parts share."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(Verb):
    """Options shared by the verbs that test a method by the paper's protocol."""

    scene: tuple[str, ...] = ("demo",)
    """Scenes by name (a wrong one lists the right ones), or paths of meshes or of Gibson folders."""
    seed: tuple[int, ...] = (0,)
    """Seeds of drive, noise, map, goals and episodes; several seeds are run one after the other."""
    preset: Literal["robust", "paper"] = "robust"
    """The navigator's settings: robust is ours, paper is the literal method."""
    without: tuple[str, ...] = ()
    """Parts of the method to switch off. One of the paper's parts: merging, pruning, expansion, fine-tuning. Or all our
    changes to one step of the paper's method: our-matching, our-building, our-localising, our-planning, our-driving,
    our-judging, our-believing, our-expanding, our-recovering. Or one of our changes by its name in config.py, for
    instance driving.swerve."""
    predictor: PredictorName = AUTO
    """Predictor that compares images: the trained network, which auto uses, or another by name."""
    weights: Path | None = None
    """Weights to start from instead of the shipped ones."""
    device: DeviceOption = "auto"
    finetune_steps: int = 40
    """Number of steps of fine-tuning on the mapping drive."""
    loops: int = 3
    """Number of rounds of the mapping drive."""
    goals: int = 10
    """Number of goal images."""
    step_limit: int | None = None
    """Number of control steps after which an episode has failed; by default as in the paper, 1,000 in scenes below 100
    m2 and 2,000 above."""
    conditions: tuple[ConditionName, ...] = ()
    """Harder conditions, the same for all systems. slip: the wheels slip, in the mapping drive and in the episodes.
    one-loop: the mapping drive is one round. half-light: the map is made in full light, and the episodes have half of
    it."""
    body: BodyOption = "auto"
    folder: FilledFolder = Path("runs/evaluation")
    """Folder of drives, weights, maps and results; the next call continues from them."""
    processes: int | None = None
    """Number of processes; by default one per core."""
    cluster: str | None = None
    """Run on a Dask cluster instead: tcp://HOST:PORT of a running one, or local:N, which starts N workers on this
    machine. All machines must have access to the folder."""
    part: str = ""
    """Only a share of the work, for arrays of independent jobs; 3/16 is the third of sixteen. When all parts have run,
    in one folder or copied into one, run the command without this option to sum up."""


@dataclass(frozen=True, kw_only=True)
class EvaluateVerb(ProtocolOptions):
    """Test a method as the paper does: map a scene, fine-tune, build, and drive random episodes without maintenance."""

    system: SystemName = DEFAULT_SYSTEM
    """The navigation system: ltvn is the paper's, the others are rivals in the same harness."""
    episodes: int = 500
    """Random episodes for each scene and seed."""
    perturb: tuple[str, ...] = ()
    """Faults of the robot's camera in the episodes, all at the same time: one or several of blur, exposure, flare,
    depth-holes, lens, noise, white-balance, jpeg, dropped-frames, or all. The map is built with a good camera."""
    record_failures: int = 0
    """Number of failed episodes per scene and seed that are run again and recorded, for `ltvn replay`."""

    def run(self) -> EvaluateSummary | PartSummary:
        """Run all episodes that have no result yet. Raises OptionError, SceneError, WeightsError, MapError and
        RecordingError."""
        from ltvn_core.evaluation.perturbations import chosen_perturbations

        if self.record_failures < 0:
            raise OptionError(f"--record-failures must be 0 or more, got {self.record_failures}.")
        plans = run_plans_of(self, self.system, self.episodes, chosen_perturbations(self.perturb))
        found = run_on_bar(self, plans, title="evaluate", unit="episode", record=self.record_failures)
        return found if isinstance(found, PartSummary) else _summary(self, *found)


def run_plans_of(
    options: ProtocolOptions, system: str, episodes: int, perturbations: tuple[str, ...] = ()
) -> "list[RunPlan]":
    """Return a plan for each scene and seed. Raises OptionError and SceneError."""
    from ltvn_core.evaluation.plans import RunPlan
    from ltvn_core.evaluation.protocol import EvaluationProtocol, protocol_under
    from ltvn_core.network.device import choose_device
    from ltvn_core.predictors.choice import ImageSource
    from ltvn_core.predictors.opening import NETWORK
    from ltvn_core.robots.robot_spec import LOCOBOT
    from ltvn_core.simulation.body_selection import choose_body
    from ltvn_core.simulation.scene_registry import check_scene

    if (
        not options.scene
        or not options.seed
        or len({*options.scene}) < len(options.scene)
        or len({*options.seed}) < len(options.seed)
    ):
        raise OptionError("--scene and --seed need at least one value, and no value twice.")
    for scene in options.scene:
        check_scene(scene)  # Check all scenes before weights are fine-tuned for one of them.
    # Body and device are chosen here and not by the workers, which may be machines with other libraries.
    body = choose_body(options.body)
    plain = EvaluationProtocol(options.loops, options.goals, episodes, step_limit=options.step_limit, body=body)
    protocol = protocol_under(plain, options.conditions)
    predictor = ImageSource(camera=LOCOBOT.camera).choose(options.predictor).name
    device = choose_device(options.device).type if predictor == NETWORK else "cpu"
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
            device=device,
            weights=options.weights,
            finetune_steps=options.finetune_steps,
            protocol=protocol,
        )
        for scene in options.scene
        for seed in options.seed
    ]


def run_on_bar(
    options: ProtocolOptions, plans: "Sequence[RunPlan]", *, title: str, unit: str, record: int = 0
) -> "tuple[list[Run], float] | PartSummary":
    """Run some plans under a progress bar, alone in their folders: another process would lose their episodes.

    Returns the finished runs and the time in seconds, or the summary of a part if other parts are unfinished. Raises
    as `run_plans` does, and RecordingError if another process runs the same part.
    """
    from tqdm import tqdm

    from ltvn_core.evaluation.plans import RunFiles
    from ltvn_core.evaluation.runner import run_plans
    from ltvn_core.evaluation.workers import Part, workers
    from ltvn_core.sole_writer import sole_user

    started = time.monotonic()
    part = Part.parse(options.part)
    with ExitStack() as stack:
        for plan in plans:
            stack.enter_context(sole_user(RunFiles.of(plan, options.folder).run / part.label))
        parallel = stack.enter_context(workers(options.processes, options.cluster, options.folder))
        bar = stack.enter_context(tqdm(desc=title, unit=unit))
        tell = shown_on(bar)
        runs = run_plans(
            plans, options.folder, command=command(), parallel=parallel, tell=tell, part=part, record=record
        )
    seconds = time.monotonic() - started
    if len(runs) < len(plans):
        return PartSummary(str(part), bar.n, len(plans), len(runs), options.folder, seconds)
    return runs, seconds


def _summary(options: EvaluateVerb, runs: "Sequence[Run]", wall_s: float) -> EvaluateSummary:
    from ltvn_core.evaluation.metrics import compute_metrics

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


def shown_on(bar: "tqdm[NoReturn]") -> "Callable[[Progress], None]":
    """Return a function that shows progress on a bar: finished work of all, and the maps until all are ready."""

    def show(found: "Progress") -> None:
        if bar.total is None:  # What earlier calls finished tells nothing about the speed.
            bar.total = found.all_rows
            bar.initial = bar.n = bar.last_print_n = found.rows
        bar.update(found.rows - bar.n)
        ready = f"{found.drives} drives, {found.weights} weights, {found.maps} maps of {found.all_maps} ready"
        bar.set_postfix_str(ready if found.maps < found.all_maps else "")

    return show
