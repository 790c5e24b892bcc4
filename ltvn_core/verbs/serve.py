"""`ltvn serve`: offers the simulated robot as a robot of ROS 2, in real time."""

import logging
import math
from contextlib import suppress
from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.verbs.body_option import BodyOption
from ltvn_core.verbs.verb import Summary, Verb

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


@dataclass(frozen=True, kw_only=True)
class ServeVerb(Verb):
    """Offer the simulated robot as a robot of ROS 2, until interrupted: it publishes images and odometry, and obeys
    velocity commands."""

    scene: str = "demo"
    """A scene by name (a wrong one lists the right ones), or the path of a mesh or of a Gibson folder."""
    profile: str = "sim"
    """Profile with the robot's topics, size and limits: locobot, nav2, sim, stretch, turtlebot4, or a TOML file."""
    listen: str = ""
    """Act as the router at this address; tcp/127.0.0.1:7447 by default. Port 0 chooses any free port."""
    connect: str = ""
    """Connect to the router at this address instead."""
    width: int = 96
    """Width of the images in pixels; the height is three quarters of it."""
    world: str | None = None
    """Change the scene over time: static, doors, daily, moving, light, people, ..., or a JSON file."""
    start: tuple[float, float, float] | None = None
    """First pose: x and y in metres of the scene, and the angle from the x axis in degrees; by default drawn by
    --seed."""
    seed: int = 0
    """Seed of the start, the odometry noise and the changes of the world."""
    body: BodyOption = "auto"

    def run(self) -> Summary:
        """Serve until interrupted; raises OptionError, RobotError and SceneError."""
        import numpy as np

        from ltvn_core.robots.robot_spec import LOCOBOT
        from ltvn_core.robots.ros2.profile import open_profile
        from ltvn_core.robots.ros2.served_robot import ServedRobot
        from ltvn_core.robots.ros2.zenoh_link import LOOPBACK, ZenohLink
        from ltvn_core.simulation.opening import open_script, open_simulation

        if self.listen and self.connect:
            raise OptionError("--listen and --connect exclude each other; give one.")
        if not 16 <= self.width <= 1920:
            raise OptionError(f"--width must be from 16 to 1920, got {self.width}.")
        profile = open_profile(self.profile)
        if profile.camera.quarter_turns or profile.camera.roll_deg:
            raise OptionError(
                f"{profile.name} has its camera on its side, which the simulator does not support; use another profile."
            )
        start = None if self.start is None else np.array([*self.start[:2], math.radians(self.start[2])])
        simulation = open_simulation(
            self.scene,
            seed=self.seed,
            start=start,
            spec=profile.spec(LOCOBOT.camera.scaled(self.width, max(self.width * 3 // 4, 1))),
            script=None if self.world is None else open_script(self.world, self.scene, seed=self.seed),
            body=self.body,
        )
        if start is not None and simulation.scene.clearance.at(start[:2]) < profile.body.radius_m:
            raise OptionError(f"--start {start[0]:g} {start[1]:g} is too close to an obstacle.")
        join = ZenohLink.connect if self.connect else ZenohLink.listen
        robot = simulation.robot
        with join(self.connect or self.listen or LOOPBACK, node="ltvn_simulator", domain=profile.domain) as link:
            served = ServedRobot(robot, link, profile, truth=lambda: robot.exact_pose)
            _LOG.info("Serving %s in %s at %s; Ctrl-C stops it.", profile.name, simulation.scene.name, link.address)
            with suppress(KeyboardInterrupt):
                served.run(lambda: False)
        return ServeSummary(simulation.scene.name, link.address, robot.stamp, robot.collisions)
