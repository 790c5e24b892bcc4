"""Prepares a trial: mapping drive, goals and episodes, fine-tuned weights, and map.

Each file is written once and atomically, so that an interrupted evaluation continues where it stopped.
"""

import json
import logging
import os
import shutil
from collections import deque
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.recording.map_file import save_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.recorded_run import record_images
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.evaluation.plans import RunFiles, open_planned_system
from ltvn_core.evaluation.protocol import EpisodePlan, choose_goals, draw_episodes
from ltvn_core.evaluation.results import load_results, save_results
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.graph.operators import pose_row
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.fine_tuning_data import SystemTraining
from ltvn_core.types import FrameId, Observation, is_usable

_LOG = logging.getLogger(__name__)

_BUILDS_WITH = ("matching", "building", "planning", "believing")
"""Groups of thresholds that affect a build; methods that differ only in other groups share their map."""


@dataclass(frozen=True, slots=True)
class DriveGroundTruth:
    """The exact poses of the images of a drive, and which of them are goals."""

    frames: tuple[FrameId, ...]
    poses: tuple[PoseRow, ...]
    goals: tuple[FrameId, ...]
    collisions: int
    """Number of collisions during the drive."""
    without_depth: int = 0
    """Number of images without depth, which are neither goals nor part of a map."""

    def episodes(self, count: int, seed: int) -> tuple[EpisodePlan, ...]:
        """Draw episodes; a larger number begins with the same ones."""
        rng = np.random.default_rng([seed, 2])
        return draw_episodes(self.frames, np.array(self.poses), self.goals, count, rng)


def prepare(files: RunFiles) -> DriveGroundTruth:
    """Create the files that are missing: drive, weights and map."""
    drive_truth = _drive(files)
    if not files.map().exists():
        if files.plan.finetuned:
            _fine_tune(files)
        _build(files, drive_truth)
    return drive_truth


def _fine_tune(files: RunFiles) -> None:
    """Fine-tune the weights of a plan on its drive."""
    plan = files.plan
    # Imported here, because learning takes long to import and an existing map does not need it.
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
    from ltvn_core.training.fine_tuning import FineTuningProvenance, fine_tune
    from ltvn_core.training.fine_tuning_data import label_drive

    training = SystemTraining(system_entry(plan.system).learning)
    name = files.weights.stem
    fine_tune(
        label_drive(_observations(files.drive), name, camera=LOCOBOT.camera, rule=training.label_rule()),
        training.rehearsal(),
        plan.start_weights,
        files.weights,
        training.adapt_plan(FineTuningPlan(minutes=None, steps=plan.finetune_steps, judge=False)),
        provenance=FineTuningProvenance(recording=files.drive.name, system=name),
        work_folder=files.weights.with_suffix(".part"),
        device=plan.device,
    )


def _drive(files: RunFiles) -> DriveGroundTruth:
    """Record a scripted tour through the scene with noisy odometry."""
    if files.drive_truth.exists():
        return load_results(files.drive_truth, DriveGroundTruth)
    plan = files.plan
    protocol = plan.protocol
    rng = np.random.default_rng([plan.seed, 0])
    simulation = open_simulation(plan.scene, seed=plan.seed, odometry_noise=protocol.odometry_noise, body=protocol.body)
    seen = list(drive_tour(simulation.robot, simulation.scene, rng, loops=protocol.loops))
    settings = {"verb": "evaluate", "seed": plan.seed, "protocol": asdict(protocol)}
    if not files.drive.exists():
        with (
            atomic_output(files.drive) as part,
            RecordingWriter(
                part,
                scene=simulation.scene.address,
                config=settings,
                fingerprint="",
                scene_glb=simulation.scene.glb(),
            ) as writer,
        ):
            deque(record_images(seen, writer), maxlen=0)
    frames = [each.step for each in seen]
    poses = np.array([each.exact_pose for each in seen])
    has_depth = np.array([each.has_depth for each in seen])
    goals = choose_goals(
        simulation.scene,
        [frame for frame, usable in zip(frames, has_depth, strict=True) if usable],
        poses[has_depth],
        protocol.goals,
        np.random.default_rng([plan.seed, 1]),
    )
    rows = tuple(pose_row(pose) for pose in poses)
    drive_truth = DriveGroundTruth(
        frames=tuple(frames),
        poses=rows,
        goals=goals,
        collisions=simulation.robot.collisions,
        without_depth=int((~has_depth).sum()),
    )
    simulation.robot.close()
    save_results(files.drive_truth, drive_truth)
    return drive_truth


def _build(files: RunFiles, drive_truth: DriveGroundTruth) -> None:
    """Build the map of a plan, or share that of another plan with the same drive and settings."""
    plan = files.plan
    scene = load_scene(plan.scene)
    predictor = open_predictor(plan.predictor, plan.scene, files.weights, device=plan.device)
    system = open_planned_system(plan, predictor, scene, maintain=False)
    thresholds = {group: asdict(getattr(system.method, group)) for group in _BUILDS_WITH}
    config = {"verb": "evaluate", "system": system.name, "predictor": plan.predictor, "method": thresholds}
    digest = sha256(json.dumps([config, predictor.fingerprint], sort_keys=True).encode()).hexdigest()[:12]
    built = files.folder / f"built-{digest}.rrd"
    if not built.exists():
        made = _built_map(files, drive_truth, TopologicalMap.of(predictor, system))
        save_map(
            built,
            made.graph,
            made.images,
            scene=scene.address,
            fingerprint=predictor.fingerprint,
            config=config,
            scene_glb=scene.glb(),
        )
    _share(built, files.map())


def _built_map(files: RunFiles, drive_truth: DriveGroundTruth, empty: TopologicalMap) -> TopologicalMap:
    plan = files.plan
    observations = _observations(files.drive)
    # A drive of an earlier version may have a goal without depth, which does not become a node.
    usable = {seen.step for seen in observations if is_usable(seen, empty.predictor)}
    goals = [goal for goal in drive_truth.goals if goal in usable]
    empty.build(observations, rng=np.random.default_rng([plan.seed, 4]), goals=goals)
    for report in empty.goal_reports(goals):
        if report.finding is not None:
            _LOG.warning("%s, seed %d: %s", plan.scene, plan.seed, report.finding)
    return empty


def _share(built: Path, wanted: Path) -> None:
    """Link a read-only file at a second path, or copy it if the file system has no links."""
    wanted.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(built, wanted)
    except OSError:
        with atomic_output(wanted) as part:
            shutil.copyfile(built, part)


def _observations(drive: Path) -> list[Observation]:
    recording = Recording.open(drive)
    return [recording.observation(frame) for frame in recording.frames]
