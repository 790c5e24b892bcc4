"""`ltvn serve`: offers the simulated robot as a robot of ROS 2, in real time."""

import logging
import math
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ltvn_core.errors import OptionError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.served_robot import ServedRobot
from ltvn_core.robots.ros2.zenoh_link import LOOPBACK, ZenohLink
from ltvn_core.simulation.opening import open_script, open_simulation
from ltvn_core.verbs.serve import ServeVerb
from ltvn_core.verbs.verb import Summary

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ServeSummary:
    """Summary when the robot is no longer served."""

    scene: str
    address: str
    """Address of the router."""
    driven_s: float
    """Duration of the run, in seconds on the robot's clock."""
    collisions: int


def serve_robot(options: ServeVerb) -> Summary:
    """Serve until interrupted; raises OptionError, RobotError and SceneError."""
    if options.listen and options.connect:
        raise OptionError("--listen and --connect exclude each other; give one.")
    if not 16 <= options.width <= 1920:
        raise OptionError(f"--width must be from 16 to 1920, got {options.width}.")
    profile = open_profile(options.profile)
    if profile.camera.quarter_turns or profile.camera.roll_deg:
        raise OptionError(
            f"{profile.name} has its camera on its side, which the simulator does not support; use another profile."
        )
    start = None if options.start is None else np.array([*options.start[:2], math.radians(options.start[2])])
    simulation = open_simulation(
        options.scene,
        seed=options.seed,
        start=start,
        spec=profile.spec(LOCOBOT.camera.scaled(options.width, max(options.width * 3 // 4, 1))),
        script=None if options.world is None else open_script(options.world, options.scene, seed=options.seed),
        body=options.body,
    )
    if start is not None and simulation.scene.clearance.at(start[:2]) < profile.body.radius_m:
        raise OptionError(f"--start {start[0]:g} {start[1]:g} is too close to an obstacle.")
    join = ZenohLink.connect if options.connect else ZenohLink.listen
    robot = simulation.robot
    with join(options.connect or options.listen or LOOPBACK, node="ltvn_simulator", domain=profile.domain) as link:
        served = ServedRobot(robot, link, profile, truth=lambda: robot.exact_pose)
        _LOG.info("Serving %s in %s at %s; Ctrl-C stops it.", profile.name, simulation.scene.name, link.address)
        with suppress(KeyboardInterrupt):
            served.run(lambda: False)
    return ServeSummary(simulation.scene.name, link.address, robot.stamp, robot.collisions)
