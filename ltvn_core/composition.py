"""Puts the siblings together: a scene with its camera and robot, a robot by name, and a predictor that fits.

Owns the choices every verb and the page share (where the robot starts, which predictor a name means). Does not own any
loop.
"""

import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import PAPER, Likelihoods, Method, preset
from ltvn_core.errors import SceneError
from ltvn_core.extras import missing_text
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.plugins import ROBOTS, find_plugins
from ltvn_core.predictors.registry import COMPOSED, GEOMETRIC, open_plugin, require_predictor
from ltvn_core.predictors.request import PredictorRequest, predictor_card
from ltvn_core.preprocessing import ORIGINAL_SIZE
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_plugins import check_robot
from ltvn_core.robots.robot_plugins import open_robot as open_live_robot
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.systems.registry import system_entry
from ltvn_core.types import FrameId, Pose, Predictor

if TYPE_CHECKING:
    from ltvn_core.simulation.body_names import BodyName
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.changes.world_script import WorldScript
    from ltvn_core.simulation.scene import Scene
    from ltvn_core.simulation.simulated_robot import SimulatedRobot
    from ltvn_core.simulation.wheel_odometry import OdometryNoise

log = logging.getLogger(__name__)

START_CLEARANCE_M = 0.35
"""A robot starts where it can turn freely."""


@dataclass(frozen=True)
class Simulation:
    """A scene and the robot in it."""

    scene: "Scene"
    robot: "SimulatedRobot"
    world: "World"
    """The scene over time; nothing changes by itself unless a script says so."""


def open_script(name: str, scene_name: str, *, seed: int) -> "WorldScript":
    """Return the script of a changing world by its name, or the one in a JSON file, for a scene.

    Raises WorldError for an unknown script, SceneError for an unknown scene.
    """
    from ltvn_core.simulation.changes.script_registry import make_script
    from ltvn_core.simulation.scene_registry import load_scene

    return make_script(name, load_scene(scene_name), seed=seed)


def open_simulation(
    scene_name: str,
    *,
    seed: int,
    first_step: FrameId = 0,
    start: Pose | None = None,
    odometry_noise: "OdometryNoise | None" = None,
    spec: RobotSpec = LOCOBOT,
    script: "WorldScript | None" = None,
    body: "BodyName" = "auto",
) -> Simulation:
    """Load a scene and put a robot of `spec` into it, at `start` (3,) or at a free place drawn with `seed`.

    `script` says what changes in the scene over time; without one nothing does by itself. `body` moves the robot, see
    `ltvn_core.simulation.body_selection`.

    Raises SceneError for an unknown scene and where the simulator cannot run at all.
    """
    try:
        from ltvn_core.simulation.simulated_robot import SimulatedRobot
    except ModuleNotFoundError as missing:
        raise SceneError(f"There is no simulator here. {missing_text(missing.name or 'trimesh')}") from missing
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.changes.world_script import STATIC
    from ltvn_core.simulation.rendering.renderer_selection import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene(scene_name)
    world = World(scene, script or STATIC)
    rng = np.random.default_rng(seed)
    place = world.scene.clearance.sample_poses(rng, 1, min_clearance_m=START_CLEARANCE_M)[0] if start is None else start
    robot = SimulatedRobot(
        scene,
        open_renderer(scene, spec.camera),
        start=place,
        rng=rng,
        odometry_noise=odometry_noise,
        first_step=first_step,
        spec=spec,
        world=world,
        body=body,
    )
    return Simulation(scene, robot, world)


def open_robot(wanted: str) -> Robot:
    """Make a robot by its name, by `path/to/file.py:factory` or by PROFILE@ADDRESS, or let a recorded drive play one.

    A drive is named by its file or folder, of any format that can be imported, or by PROFILE@PATH. One image is taken;
    nothing is driven. Raises PluginError, RobotError and DriveError.
    """
    from ltvn_core.importing.named_drive import NamedDrive
    from ltvn_core.importing.played_drive import play_drive

    drive = None if wanted in find_plugins(ROBOTS) else NamedDrive.find(wanted)
    if drive is None:
        return open_live_robot(wanted)
    robot = play_drive(drive)
    check_robot(robot, wanted)
    return robot


def simulated_robot(predictor: str) -> RobotSpec:
    """Return the LoCoBot with a camera that suits the predictor of that name: key points need a larger picture."""
    if predictor not in (GEOMETRIC, COMPOSED):
        return LOCOBOT
    return replace(LOCOBOT, camera=LOCOBOT.camera.scaled(ORIGINAL_SIZE.long_side, ORIGINAL_SIZE.short_side))


def open_predictor(
    name: str, scene_name: str = "", weights: Path | None = None, *, camera: CameraModel = LOCOBOT.camera
) -> Predictor:
    """Return the predictor of that name.

    Args:
        name: `network`, `geometric`, `oracle`, or what another package adds to the entry points `ltvn.predictors`.
        scene_name: Where the images are taken; it matters to the oracle alone.
        weights: Weights to use instead of the shipped ones.
        camera: Of the recording, the map or the robot; an image larger than 320 x 240 is made smaller.

    Raises:
        OptionError: No predictor has that name; the message lists those there are.
        PluginError: Another package's predictor is broken.
        WeightsError: The weights are missing or damaged.
        MissingLibraryError: A library that it needs is not installed.
        SceneError: The oracle is asked about a scene that is not simulated.
    """
    return open_plugin(require_predictor(name), PredictorRequest(scene_name, weights, _at_most_original_size(camera)))


def _at_most_original_size(camera: CameraModel) -> CameraModel:
    scale = ORIGINAL_SIZE.scale_of(camera.width, camera.height)
    if scale < 1:
        camera = camera.scaled(max(round(camera.width * scale), 1), max(round(camera.height * scale), 1))
    return replace(camera, depth_scale=1.0)  # Depth has come through the door and is in metres.


def open_method(name: str, predictor: Predictor, *, likelihoods: Likelihoods | None = None) -> Method:
    """Return a preset whose constants of Eq. 3 and Eq. 4 are those measured for the predictor.

    `likelihoods` win over measured ones; where nothing was measured the preset's own stay. Raises OptionError for an
    unknown preset and WeightsError for a damaged card.
    """
    method = preset(name)
    card = predictor_card(predictor)
    if card.merge_distance is not None and method is not PAPER:
        nearest = min(card.merge_distance, method.building.merge_distance)
        method = replace(method, building=replace(method.building, merge_distance=nearest))
    constants = likelihoods or card.likelihoods
    if constants is None:
        log.info(
            "Nobody measured this predictor; Eq. 3 and Eq. 4 use general constants. `ltvn measure --write` does it for "
            "weights."
        )
        return method
    return replace(method, believing=replace(method.believing, **asdict(constants)))


def open_system(name: str, method: Method) -> NavigationSystem:
    """Return a navigation system by its name.

    Args:
        name: `ltvn`, `sptm`, `ving`, or what another package adds to the entry points `ltvn.systems`.
        method: The thresholds it is to use.

    Raises:
        OptionError: No system has that name; the message lists those there are.
    """
    return system_entry(name).factory(method)
