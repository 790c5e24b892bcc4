"""Puts the siblings together: a scene with its camera and robot, and a predictor that fits.

Owns the choices every verb and the page share (where the robot starts, which predictor a name means). Does not own any
loop.
"""

import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from ltvn_core.config import Likelihoods, Method, preset
from ltvn_core.errors import SceneError
from ltvn_core.extras import missing_text, naming_the_extra
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.systems.registry import system_entry
from ltvn_core.types import FrameId, Pose, Predictor

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene
    from ltvn_core.simulation.simulated_robot import SimulatedRobot
    from ltvn_core.simulation.wheel_odometry import OdometryNoise

log = logging.getLogger(__name__)

PredictorName: TypeAlias = Literal["network", "oracle"]
"""The trained network, or the simulator's own geometry."""

START_CLEARANCE_M = 0.35
"""A robot starts where it can turn freely."""


@dataclass(frozen=True)
class Simulation:
    """A scene and the robot in it."""

    scene: "Scene"
    robot: "SimulatedRobot"


def open_simulation(
    scene_name: str,
    *,
    seed: int,
    first_step: FrameId = 0,
    start: Pose | None = None,
    odometry_noise: "OdometryNoise | None" = None,
    spec: RobotSpec = LOCOBOT,
) -> Simulation:
    """Load a scene and put a robot of `spec` into it, at `start` (3,) or at a free place drawn with `seed`.

    Raises SceneError for an unknown scene and where the simulator cannot run at all.
    """
    try:
        from ltvn_core.simulation.simulated_robot import SimulatedRobot
    except ModuleNotFoundError as missing:
        raise SceneError(f"There is no simulator here. {missing_text(missing.name or 'pybullet')}") from missing
    from ltvn_core.simulation.rendering.renderer_selection import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene(scene_name)
    rng = np.random.default_rng(seed)
    place = scene.clearance.sample_poses(rng, 1, min_clearance_m=START_CLEARANCE_M)[0] if start is None else start
    robot = SimulatedRobot(
        scene,
        open_renderer(scene, spec.camera),
        start=place,
        rng=rng,
        odometry_noise=odometry_noise,
        first_step=first_step,
        spec=spec,
    )
    return Simulation(scene, robot)


def open_predictor(name: PredictorName, scene_name: str, weights: Path | None = None) -> Predictor:
    """Return the predictor of that name; `weights` replaces the shipped ones, the scene matters to the oracle alone.

    Raises WeightsError, MissingLibraryError without PyTorch, and SceneError when the oracle is asked about a scene
    that is not simulated.
    """
    if name == "oracle":
        from ltvn_core.simulation.oracle_predictor import OraclePredictor
        from ltvn_core.simulation.scene_registry import load_scene

        return OraclePredictor(load_scene(scene_name).clearance, LOCOBOT.camera)
    with naming_the_extra():
        from ltvn_core.network.predictor import load_predictor

    return load_predictor(weights)


def open_method(
    name: str, predictor: PredictorName, weights: Path | None = None, *, likelihoods: Likelihoods | None = None
) -> Method:
    """Return a preset whose constants of Eq. 3 and Eq. 4 are those measured for the predictor, see `open_predictor`.

    `likelihoods` win over measured ones; where nothing was measured the preset's own stay. Raises OptionError for an
    unknown preset and WeightsError for a damaged card.
    """
    method = preset(name)
    constants = likelihoods or _measured_likelihoods(predictor, weights)
    if constants is None:
        log.info(
            "Nobody measured these weights; Eq. 3 and Eq. 4 use general constants. `ltvn measure --write` does it."
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


def _measured_likelihoods(predictor: PredictorName, weights: Path | None) -> Likelihoods | None:
    if predictor == "oracle":
        from ltvn_core.simulation.oracle_predictor import LIKELIHOODS

        return LIKELIHOODS
    from ltvn_core.network.cards.driving_calibration import likelihoods, read_driving
    from ltvn_core.network.weights_file import matching_card

    measured = read_driving(matching_card(weights or SHIPPED_WEIGHTS))
    return None if measured is None else likelihoods(measured)
