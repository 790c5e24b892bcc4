"""`ltvn evaluate`: the paper's protocol, for LTVN and its rivals."""

import shlex
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.condition_names import ConditionName
from ltvn_core.systems.registry import DEFAULT_SYSTEM
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.part_summary import PartSummary
from ltvn_core.verbs.predictor_option import AUTO, PredictorName
from ltvn_core.verbs.system_option import SystemName
from ltvn_core.verbs.verb import Verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ltvn_core.evaluation.protocol import EvaluationProtocol
    from ltvn_core.evaluation.results import TrialResult
    from ltvn_core.evaluation.trial_plans import TrialPlan
    from ltvn_core.verbs.robot_evaluation import RobotEvaluationSummary


@dataclass(frozen=True)
class EvaluateSummary:
    """What the episodes of all scenes and seeds came to."""

    scenes: tuple[str, ...]
    method: str
    preset: str
    without: tuple[str, ...]
    seeds: tuple[int, ...]
    episodes: int
    """In all."""
    success_rate: float
    success_low: float
    """95 % interval."""
    success_high: float
    spl: float
    """Success weighted by path length."""
    collisions_per_episode: float
    steps_per_episode: float
    """Control steps of 0.1 s."""
    nodes: float
    """Mean over the maps, as are the next two."""
    edges: float
    spurious_edges: float
    """Edges that nobody can drive, by the simulator's truth."""
    failures: dict[str, int]
    """Episodes that failed, by cause."""
    images_without_depth: int
    """Images of all mapping drives in which the camera found no depth; they are in the drives and not in the maps."""
    folder: Path
    """Holds drives, weights, maps and results; called again, the verb goes on from there."""
    wall_s: float


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions(Verb):
    """Options shared by the verbs that test a method as the paper does."""

    scene: tuple[str, ...] = ("demo",)
    """Scenes by name (a wrong one lists the right ones), or paths of meshes or of Gibson folders."""
    seed: tuple[int, ...] = (0,)
    """Draws drive, noise, map, goals and episodes; several are run one after the other."""
    preset: Literal["robust", "paper"] = "robust"
    """The navigator's settings: robust is ours, paper is the literal method."""
    without: tuple[str, ...] = ()
    """Parts to switch off: merging, pruning, expansion, fine-tuning; or our departures from the paper in one respect:
    our-matching, our-building, our-localising, our-planning, our-driving, our-judging, our-believing, our-expanding,
    our-recovering."""
    predictor: PredictorName = AUTO
    """What compares images: the trained network, which auto takes, or another by name."""
    weights: Path | None = None
    """Weights to start from instead of the shipped ones."""
    finetune_steps: int = 40
    """Steps of fine-tuning on the mapping drive."""
    loops: int = 3
    """Rounds of the mapping drive."""
    goals: int = 10
    """Goal images."""
    step_limit: int | None = None
    """Control steps after which an episode failed; by default the paper's, 1,000 below 100 m2 and 2,000 above."""
    conditions: tuple[ConditionName, ...] = ()
    """What is harder than usual, for all systems alike: slip (the wheels slip, in the mapping drive and the episodes),
    one-loop (the mapping drive is one round), half-light (the map is made in full light and driven in half of it)."""
    body: BodyOption = "auto"
    folder: Path = Path("runs/evaluation")
    """Where drives, weights, maps and results are kept, and found again by the next call."""
    workers: int | None = None
    """Processes to run side by side; by default as many as there are cores."""
    cluster: str | None = None
    """A cluster instead: ray://HOST:PORT or tcp://HOST:PORT (Dask) that is running, or local:N, which starts N workers
    of Dask here; all machines must see the folder."""
    part: str = ""
    """Only a share of the work, as 3/16 is the third of sixteen: for arrays of jobs that know nothing of each other.
    Once all have run, in one folder or copied into one, the command without it sums up."""

    def protocol(self, episodes: int) -> "EvaluationProtocol":
        """Return the numbers of the test. Raises OptionError."""
        from ltvn_core.evaluation.conditions import protocol_under
        from ltvn_core.evaluation.protocol import EvaluationProtocol
        from ltvn_core.simulation.body_selection import choose_body

        # Chosen here and not by the workers, which may be machines with other libraries.
        body = choose_body(self.body)
        protocol = EvaluationProtocol(self.loops, self.goals, episodes, step_limit=self.step_limit, body=body)
        return protocol_under(protocol, self.conditions)

    def plans(self, method: str, episodes: int, perturbations: tuple[str, ...] = ()) -> "list[TrialPlan]":
        """Return a plan for each scene and seed. Raises OptionError."""
        from ltvn_core.evaluation.trial_plans import TrialPlan
        from ltvn_core.predictors.choice import ImageSource
        from ltvn_core.robots.robot_spec import LOCOBOT

        if (
            not self.scene
            or not self.seed
            or len({*self.scene}) < len(self.scene)
            or len({*self.seed}) < len(self.seed)
        ):
            raise OptionError("--scene and --seed need one value at least, and none of them twice.")
        protocol = self.protocol(episodes)
        predictor = ImageSource(camera=LOCOBOT.camera).choose(self.predictor).name
        return [
            TrialPlan(
                scene=scene,
                seed=seed,
                system=method,
                preset=self.preset,
                parts_off=tuple(sorted(self.without)),
                perturbations=perturbations,
                conditions=tuple(sorted(set(self.conditions))),
                predictor=predictor,
                weights=self.weights,
                finetune_steps=self.finetune_steps,
                protocol=protocol,
            )
            for scene in self.scene
            for seed in self.seed
        ]


@dataclass(frozen=True, kw_only=True)
class EvaluateVerb(ProtocolOptions):
    """Test a method as the paper does: map a scene, fine-tune, build, and drive random episodes without maintenance."""

    method: SystemName = DEFAULT_SYSTEM
    """Ours, or a rival in the same harness."""
    episodes: int | None = None
    """Random episodes for each scene and seed, 500 by default; with --robot 20, before the queries and after."""
    robot: str | None = None
    """Test a robot of your own instead, in real time (the paper's Table II): episodes without maintenance, --queries
    with it, and the same episodes again. An installed robot's name, path/to/file.py:factory, or PROFILE@ADDRESS."""
    map: Path | None = None
    """The map of the place that --robot is in."""
    queries: int = 30
    """With --robot: queries with maintenance between the episodes."""
    perturb: str = ""
    """What is wrong with the robot's camera in the episodes, all at once: a list of blur, exposure, flare, depth-holes,
    lens, noise, white-balance, jpeg, dropped-frames, separated by commas. The map is of a good camera."""
    record_failures: int = 0
    """Run so many of the failed episodes of each scene and seed again and record them, for `ltvn replay`."""

    def run(self) -> "EvaluateSummary | PartSummary | RobotEvaluationSummary":
        """Run what is not done yet.

        Raises OptionError, SceneError, WeightsError, MapError, RecordingError and RobotError.
        """
        if self.robot is not None:
            return self._with_robot(self.robot)
        if self.map is not None:
            raise OptionError("--map is for --robot; in a scene the map is made by a mapping drive.")
        return self._in_scenes(500 if self.episodes is None else self.episodes)

    def _with_robot(self, robot: str) -> "RobotEvaluationSummary":
        from ltvn_core.verbs.navigate_options import NavigateOptions
        from ltvn_core.verbs.robot_evaluation import RobotEvaluation, evaluate_robot

        episodes = 20 if self.episodes is None else self.episodes
        if self.map is None:
            raise OptionError("--robot wants --map: the map of the place that it is in.")
        if episodes < 1 or self.queries < 0 or len(self.seed) != 1:
            raise OptionError("--robot takes --episodes of 1 or more, --queries of 0 or more, and one --seed.")
        folder = self.folder / "robot" if self.folder == Path("runs/evaluation") else self.folder
        drive = NavigateOptions(
            map=self.map,
            recording=folder,
            preset=self.preset,
            predictor=self.predictor,
            weights=self.weights,
            seed=self.seed[0],
        )
        return evaluate_robot(
            RobotEvaluation(robot=robot, map=drive, episodes=episodes, queries=self.queries, folder=folder)
        )

    def _in_scenes(self, episodes: int) -> EvaluateSummary | PartSummary:
        """Run what is not done yet in simulation."""
        from joblib import delayed
        from tqdm import tqdm

        from ltvn_core.evaluation.failure_recordings import record_failures
        from ltvn_core.evaluation.parts import Part
        from ltvn_core.evaluation.perturbations.perturbation_registry import parse_perturbations
        from ltvn_core.evaluation.trial_plans import TrialFiles
        from ltvn_core.evaluation.trials import episodes_to_run, run_trials
        from ltvn_core.evaluation.workers import workers
        from ltvn_core.verbs.evaluation_bar import progress_on_bar

        if self.record_failures < 0:
            raise OptionError(f"--record-failures must be 0 or more, got {self.record_failures}.")
        started, part = time.monotonic(), Part.parse(self.part)
        plans = self.plans(self.method, episodes, parse_perturbations(self.perturb))
        with (
            workers(self.workers, self.cluster, self.folder) as parallel,
            tqdm(total=episodes_to_run(plans, episodes, part), desc="evaluate", unit="episode") as bar,
        ):
            trials = run_trials(
                plans,
                self.folder,
                episodes=episodes,
                command=command(),
                parallel=parallel,
                progress=progress_on_bar(bar, len(plans)),
                part=part,
            )
            if len(trials) < len(plans):
                return PartSummary(str(part), bar.n, len(plans), len(trials), self.folder, time.monotonic() - started)
            if self.record_failures:
                jobs = [(plan, TrialFiles.of(plan, self.folder)) for plan in plans]
                again = zip(jobs, trials, strict=True)
                list(parallel(delayed(record_failures)(*job, trial, self.record_failures) for job, trial in again))
        return self._summary(trials, time.monotonic() - started)

    def _summary(self, trials: "Sequence[TrialResult]", wall_s: float) -> EvaluateSummary:
        from ltvn_core.evaluation.metrics import compute_metrics

        found = compute_metrics(trials)
        return EvaluateSummary(
            scenes=self.scene,
            method=self.method,
            preset=self.preset,
            without=self.without,
            seeds=self.seed,
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
            folder=self.folder,
            wall_s=wall_s,
        )


def command() -> str:
    """Return the command line that is running, without the folder that leads to the program."""
    return shlex.join(["ltvn", *sys.argv[1:]])
