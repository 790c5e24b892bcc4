"""The session's robot, with scene, renderer and ground truth in simulation; or the reason why there is none.

Owns the start pose of a simulated robot. A user's own robot has no renderer, no scene and no ground truth; to watch
recordings, no robot is needed.

Stand-ins replace a simulator or network that is not installed; they only report what is missing.
"""

import logging
import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NoReturn

import cv2
import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.data.recording.map_file import LoadedMap
from ltvn_core.data.recording.metadata import SOURCE_SCENE
from ltvn_core.errors import LtvnError, MissingLibraryError, SceneError, WeightsError
from ltvn_core.extras import naming_the_extra
from ltvn_core.network.driving_calibration import measured_likelihoods
from ltvn_core.predictors.opening import NETWORK, open_predictor, simulated_robot
from ltvn_core.robots.robot import Robot, WallClock
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.robots.robot_view import fit_camera
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import STATIC
from ltvn_core.simulation.opening import START_CLEARANCE_M, Simulation, open_simulation
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.types import Features, Observation, Pose, Prediction, Predictor, Renderer, RobotState, Twist
from ltvn_viz.session.camera_feed import LargerFeed
from ltvn_viz.session.live_run import LiveRobot
from ltvn_viz.session.options import AppOptions

NO_PREDICTOR = "none"
"""Fingerprint of a missing predictor."""


class AbsentRobot:
    """Stand-in for a missing robot; it never moves. Implements `ltvn_core.robots.robot.Robot`."""

    spec = LOCOBOT
    clock = WallClock()

    def __init__(self, why: LtvnError) -> None:
        """Remember why there is no robot."""
        self._why = why

    def observe(self) -> Observation:
        """Raise SceneError."""
        raise SceneError(f"There is no robot to drive: {self._why}")

    def state(self) -> RobotState:
        """Return a pose of NaN, which is not drawn."""
        return RobotState(np.full(3, np.nan), stamp=0.0, step=0, bumper_pressed=False)

    def drive(self, twist: Twist) -> None:
        """Do nothing."""

    def stop(self) -> None:
        """Do nothing."""


class AbsentPredictor:
    """Stand-in for a missing network; it cannot compare images. Implements `ltvn_core.types.Predictor`."""

    fingerprint = NO_PREDICTOR
    camera = LOCOBOT.camera

    def __init__(self, why: LtvnError, likelihoods: Likelihoods | None = None) -> None:
        """Keep the reason why there is no network, and its measurements."""
        self._why = why
        self.likelihoods = likelihoods

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Raise the error."""
        self._refuse()

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Raise the error."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise self._why


logger = logging.getLogger(__name__)

COARSE, FINE = (320, 240), (640, 480)
"""Columns and rows of the larger picture, in motion and at rest."""
START_CANDIDATES = 16


@dataclass(frozen=True, kw_only=True)
class Backend:
    """The robot and its environment."""

    robot: Robot
    """The robot; a stand-in if recordings are only watched."""
    simulation: Simulation | None = None
    """The simulated robot in its scene; None for the user's own robot."""
    renderer: Renderer | None = None
    """Draws larger images for people, in simulation only."""

    @property
    def is_absent(self) -> bool:
        """Whether there is no robot to drive."""
        return isinstance(self.robot, AbsentRobot)


def predictor_for(options: AppOptions, camera: CameraModel) -> Predictor:
    """Open the predictor for a camera; if a recording is only watched, a stand-in replaces a missing predictor.

    Raises LtvnError.
    """
    try:
        return open_predictor(
            options.predictor, options.scene, options.start_weights, camera=camera, device=options.device
        )
    except (SceneError, WeightsError, MissingLibraryError) as missing:
        if options.replay is None:
            raise
        weights = options.start_weights
        likelihoods = None
        if options.predictor == NETWORK and weights is not None:
            likelihoods = measured_likelihoods(weights)
        return AbsentPredictor(missing, likelihoods)


def open_backend(options: AppOptions, known: LoadedMap | None, stack: ExitStack) -> Backend:
    """Open the simulator, to be closed by `stack`; if a recording is only watched, it may be missing.

    The options must name the predictor and not `auto`, because the robot's camera depends on it. Raises SceneError,
    MissingLibraryError.
    """
    try:
        if options.replay is not None and options.scene.startswith(SOURCE_SCENE):
            raise SceneError(f"{options.scene} is the place of an imported drive, not a simulated scene.")
        with naming_the_extra():
            return _open_simulator(options, known, stack)
    except (SceneError, MissingLibraryError) as missing:
        if options.replay is None:
            raise
        logger.info("Watching only, because nothing can be driven here: %s", missing)
        return Backend(robot=AbsentRobot(missing))


def _open_simulator(options: AppOptions, known: LoadedMap | None, stack: ExitStack) -> Backend:
    """Open the simulator, to be closed by `stack`. Raises SceneError and ModuleNotFoundError."""
    scene = load_scene(options.scene)
    renderer = EmbreeRenderer(scene.surfaces, supersampling=1)
    script = STATIC if options.world is None else make_script(options.world, scene, seed=options.seed)
    as_it_is = World(scene, script).scene
    renderer.show(as_it_is)
    start = _start(as_it_is, renderer, known, np.random.default_rng(options.seed))
    first_step = 0 if known is None else max(known.observations) + 1
    simulation = open_simulation(
        options.scene,
        seed=options.seed,
        first_step=first_step,
        start=start,
        spec=simulated_robot(options.predictor),
        script=script,
        body=options.body,
    )
    stack.callback(simulation.robot.close)
    simulation.world.follow(lambda _: renderer.show(simulation.world.scene))
    return Backend(robot=simulation.robot, simulation=simulation, renderer=renderer)


def live_robot(backend: Backend, predictor: Predictor, known: LoadedMap | None) -> LiveRobot:
    """Return the robot for the session, with images for the predictor's camera; a stand-in if there is none.

    Its images and stamps continue those of a `known` map.
    """
    if backend.is_absent:
        return LiveRobot(backend.robot)
    simulation = backend.simulation
    seen = () if known is None else known.observations.values()
    return LiveRobot(
        fit_camera(backend.robot, predictor.camera),
        last_step=max((each.step for each in seen), default=-1),
        # A simulator continues the time of the map by itself.
        last_stamp_s=-math.inf
        if backend.robot.clock.is_simulated
        else max((each.stamp for each in seen), default=-math.inf),
        ground_truth=None if simulation is None else lambda: simulation.robot.exact_pose,
    )


def open_larger_feed(backend: Backend, stack: ExitStack) -> LargerFeed | None:
    """Open the larger picture for people, to be closed by `stack`; None if it cannot be rendered."""
    renderer, simulation = backend.renderer, backend.simulation
    if renderer is None or simulation is None:
        return None
    coarse, fine = (backend.robot.spec.camera.scaled(*size) for size in (COARSE, FINE))

    def render(pose: Pose, is_fine: bool) -> bytes:
        rgb, _ = renderer.render(pose, fine if is_fine else coarse)
        return cv2.imencode(".jpg", rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 85))[1].tobytes()

    feed = LargerFeed(render, look=lambda: simulation.world.state)
    stack.callback(feed.close)
    return feed


def _start(scene: Scene, renderer: EmbreeRenderer, known: LoadedMap | None, rng: np.random.Generator) -> Pose:
    """Draw a start pose, on the map if there is one, where the camera sees more than a wall."""
    candidates = scene.clearance.sample_poses(rng, START_CANDIDATES, min_clearance_m=START_CLEARANCE_M)
    if known is not None:
        poses = [known.observations[node].exact_pose for node in known.graph.nodes]
        mapped = np.array([pose for pose in poses if pose is not None]).reshape(-1, 3)
        mapped = mapped[scene.clearance.at(mapped[:, :2]) >= START_CLEARANCE_M]
        candidates = rng.permutation(mapped)[:START_CANDIDATES] if len(mapped) else candidates
    depths = [float(np.median(renderer.render(pose, LOCOBOT.camera)[1])) for pose in candidates]
    return candidates[int(np.argmax(depths))]
