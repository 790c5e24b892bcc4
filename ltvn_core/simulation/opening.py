"""Opens a simulation: a scene by its name, the robot in it, and the script of changes in the world.

Owns the choice of the robot's start. Runs no loop.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.errors import SceneError
from ltvn_core.extras import missing_text
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.types import FrameId, Pose

if TYPE_CHECKING:
    from ltvn_core.simulation.body_names import BodyName
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.changes.world_script import WorldScript
    from ltvn_core.simulation.scene import Scene
    from ltvn_core.simulation.simulated_robot import SimulatedRobot
    from ltvn_core.simulation.wheel_odometry import OdometryNoise

START_CLEARANCE_M = 0.35
"""Clearance of a random start, in metres, so that the robot can turn freely."""


@dataclass(frozen=True)
class Simulation:
    """A scene and the robot in it."""

    scene: "Scene"
    robot: "SimulatedRobot"
    world: "World"
    """The scene over time; it changes only by a script or by hand."""


def open_script(name: str, scene_name: str, *, seed: int) -> "WorldScript":
    """Return the script of a changing world by its name, or the one in a JSON file, for a scene.

    Raises WorldError for an unknown script, SceneError for an unknown scene.
    """
    from ltvn_core.simulation.changes.script_registry import make_script
    from ltvn_core.simulation.scene_registry import load_scene

    return make_script(name, load_scene(scene_name), seed=seed)


def open_simulation(
    scene_name: str | Path,
    *,
    seed: int,
    first_step: FrameId = 0,
    start: Pose | None = None,
    odometry_noise: "OdometryNoise | None" = None,
    spec: RobotSpec = LOCOBOT,
    script: "WorldScript | None" = None,
    body: "BodyName" = "auto",
) -> Simulation:
    """Load a scene and put a robot into it.

    Args:
        scene_name: Name of a scene, such as `demo` or `apartment-57`, or the file of a mesh.
        seed: Seed of the robot's start and of noise.
        first_step: Control step at which the robot's clock begins.
        start: Pose (3,) of the robot, in metres and radians; a free place by default.
        odometry_noise: Noise of odometry; none by default.
        spec: Size, speeds and camera of the robot.
        script: Changes of the scene over time; none by default.
        body: What moves the robot, see `ltvn_core.simulation.body_selection`.

    Raises:
        SceneError: The scene is unknown, or the simulator cannot run here.
    """
    try:
        from ltvn_core.simulation.simulated_robot import SimulatedRobot
    except ModuleNotFoundError as missing:
        raise SceneError(f"There is no simulator here. {missing_text(missing.name or 'trimesh')}") from missing
    from ltvn_core.simulation.changes.world import World
    from ltvn_core.simulation.changes.world_script import STATIC
    from ltvn_core.simulation.rendering.renderer_opening import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene(str(scene_name))
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
