"""What every episode needs: a mapping drive with its goals and episodes, weights that know the drive, and a map.

Owns how these come about. Each file is written once, whole or not at all, so that an interrupted evaluation goes on
where it stopped.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ltvn_core.composition import open_predictor, open_simulation
from ltvn_core.evaluate.plans import TrialFiles, TrialPlan, open_system, shipped_weights
from ltvn_core.evaluate.protocol import EpisodePlan, choose_goals, draw_episodes
from ltvn_core.evaluate.results import load_results, save_results
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.recording.maps import save_map
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.whole import written_whole
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.sim.odometry import OdometryNoise
from ltvn_core.sim.scenes import load_scene
from ltvn_core.sim.tour import tour
from ltvn_core.types import FrameId, Observation


@dataclass(frozen=True, slots=True)
class Sights:
    """Where the images of a drive were truly taken, and which of them are goals."""

    frames: tuple[FrameId, ...]
    poses: tuple[PoseRow, ...]
    goals: tuple[FrameId, ...]
    collisions: int
    """Touches on the way."""

    def episodes(self, count: int, seed: int) -> tuple[EpisodePlan, ...]:
        """Draw episodes; more of them begin with the same ones."""
        rng = np.random.default_rng([seed, 2])
        return draw_episodes(self.frames, np.array(self.poses), self.goals, count, rng)


def prepare(plan: TrialPlan, files: TrialFiles) -> Sights:
    """Make what is not there yet: drive, weights and map. Raises the errors of the parts."""
    sights = _drive(plan, files)
    if not files.map().exists():
        observations = _observations(files.drive)
        _build(plan, files, observations, sights, tuned_weights(plan, files, observations))
    return sights


def tuned_weights(plan: TrialPlan, files: TrialFiles, observations: Sequence[Observation] = ()) -> Path:
    """Return the weights of a plan, fine-tuned on its drive at the first call."""
    start = plan.weights or shipped_weights(plan.system)
    if not plan.finetuned:
        return start
    if not files.weights.exists():
        # Only here, because learning takes long to load and a map that is there already needs none.
        from ltvn_core.lessons.own_weights import finetune_for
        from ltvn_core.model.finetuning import FineTuningPlan

        steps = FineTuningPlan(minutes=None, steps=plan.finetune_steps, judge=False)
        finetune_for(plan.system, observations, start, steps, files.weights.with_suffix(".part"), files.weights)
    return files.weights


def _drive(plan: TrialPlan, files: TrialFiles) -> Sights:
    """Let a scripted person map the scene, with an odometer that errs."""
    if files.sights.exists():
        return load_results(files.sights, Sights)
    protocol, rng = plan.protocol, np.random.default_rng([plan.seed, 0])
    noise = OdometryNoise(protocol.distance_noise, protocol.angle_noise)
    simulation = open_simulation(plan.scene, seed=plan.seed, odometry_noise=noise)
    seen = list(tour(simulation.robot, simulation.scene, rng, loops=protocol.loops))
    settings = {"verb": "evaluate", "seed": plan.seed, "protocol": asdict(protocol)}
    if not files.drive.exists():
        with (
            written_whole(files.drive) as part,
            RecordingWriter(part, scene=simulation.scene.address, config=settings, fingerprint="") as writer,
        ):
            for observation in seen:
                writer.frame(observation)
    frames, poses = [each.step for each in seen], np.array([each.exact_pose for each in seen])
    goals = choose_goals(simulation.scene, frames, poses, protocol.goals, np.random.default_rng([plan.seed, 1]))
    rows = tuple(pose_row(pose) for pose in poses)
    sights = Sights(tuple(frames), rows, goals, simulation.robot.collisions)
    simulation.robot.close()
    save_results(files.sights, sights)
    return sights


def _build(
    plan: TrialPlan, files: TrialFiles, observations: Sequence[Observation], sights: Sights, weights: Path
) -> None:
    scene = load_scene(plan.scene)
    predictor = open_predictor(plan.predictor, plan.scene, weights)
    system = open_system(plan, weights, scene, maintain=False)
    views = Views(predictor)
    rng = np.random.default_rng([plan.seed, 4])
    deltas = system.build(observations, views, predictor, rng=rng, goals=sights.goals)
    graph, kept = TopologicalGraph(deltas), [views.observation(frame) for frame in views.frames]
    config = {"verb": "evaluate", "system": system.name, "method": asdict(system.method)}
    save_map(files.map(), graph, kept, scene=scene.address, fingerprint=predictor.fingerprint, config=config)


def _observations(drive: Path) -> list[Observation]:
    recording = Recording.open(drive)
    return [recording.observation(frame) for frame in recording.frames]
