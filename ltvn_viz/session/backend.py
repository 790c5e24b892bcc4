"""Who plays: a simulated robot and what it compares images with, or stand-ins where one only watches a recording."""

from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from ltvn_core.composition import START_CLEARANCE_M, Simulation, open_predictor, open_simulation
from ltvn_core.errors import MissingLibraryError, SceneError, WeightsError
from ltvn_core.recording.map_file import LoadedMap
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Pose, Predictor
from ltvn_viz.session.absent_backend import AbsentFeed, AbsentPredictor, AbsentRobot
from ltvn_viz.session.camera_feed import CameraFeed, ImageFeed
from ltvn_viz.session.live_run import LiveRobot
from ltvn_viz.session.options import AppOptions

DISPLAY_CAMERA = LOCOBOT.camera.scaled(320, 240)
START_CANDIDATES = 16


@dataclass(frozen=True)
class Backend:
    """The robot and what it sees with."""

    robot: LiveRobot
    feed: ImageFeed
    simulation: Simulation | None
    """None when the robot is a stand-in."""


def predictor_for(options: AppOptions) -> Predictor:
    """Open the predictor; when a recording is only to be watched, a missing one is replaced. Raises LtvnError."""
    try:
        return open_predictor(options.predictor, options.scene, options.weights)
    except (SceneError, WeightsError, MissingLibraryError) as missing:
        if options.replay is None:
            raise
        return AbsentPredictor(missing)


def open_backend(options: AppOptions, known: LoadedMap | None, stack: ExitStack) -> Backend:
    """Open scene, robot and camera, to be closed by `stack`; replaced likewise where missing. Raises SceneError."""
    try:
        scene = load_scene(options.scene)
        renderer = EmbreeRenderer(scene.surfaces, supersampling=1)
        start = _start(scene, renderer, known, np.random.default_rng(options.seed))
        first_step = 0 if known is None else max(known.observations) + 1
        simulation = open_simulation(options.scene, seed=options.seed, first_step=first_step, start=start)
    except SceneError as missing:
        if options.replay is None:
            raise
        return Backend(AbsentRobot(missing), AbsentFeed(), None)
    stack.callback(simulation.robot.close)
    feed = CameraFeed(lambda pose: renderer.render(pose, DISPLAY_CAMERA))
    stack.callback(feed.close)
    return Backend(simulation.robot, feed, simulation)


def _start(scene: Scene, renderer: EmbreeRenderer, known: LoadedMap | None, rng: np.random.Generator) -> Pose:
    """Draw a place, on the map if there is one, from which there is something to see: nobody likes to face a wall."""
    candidates = scene.clearance.sample_poses(rng, START_CANDIDATES, min_clearance_m=START_CLEARANCE_M)
    if known is not None:
        poses = [known.observations[node].exact_pose for node in known.graph.nodes]
        mapped = np.array([pose for pose in poses if pose is not None]).reshape(-1, 3)
        mapped = mapped[scene.clearance.at(mapped[:, :2]) >= START_CLEARANCE_M]
        candidates = rng.permutation(mapped)[:START_CANDIDATES] if len(mapped) else candidates
    depths = [float(np.median(renderer.render(pose, LOCOBOT.camera)[1])) for pose in candidates]
    return candidates[int(np.argmax(depths))]
