"""`ltvn guard`: forwards only fresh commands to a robot's wheels."""

import logging
from contextlib import suppress
from dataclasses import dataclass

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class GuardSummary:
    """Summary when the guard has ended, and the robot stands still."""

    forwarded: int
    """Number of forwarded commands."""
    refused: int
    """Number of refused commands: late, out of order, not finite, from a second sender, or without a stop after
    silence."""


@dataclass(frozen=True, kw_only=True)
class GuardVerb(Verb):
    """Run a watchdog on the robot's own computer, between the driver and the wheels, until interrupted.

    Forwards fresh commands from the profile's guard topic to its command topic, within its limits of speed and
    acceleration. After 0.2 s without commands, or an invalid one, it sends one zero; then the driver must send a stop
    before it may drive again.
    """

    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/127.0.0.1:7447."""
    depth_stop: float | None = None
    """Drive forward only while the depth image shows that the way is free up to this distance before the body, in
    metres."""

    def run(self) -> Summary:
        """Guard until interrupted; raises OptionError and RobotError."""
        from ltvn_core.robots.ros2.guard import Guard
        from ltvn_core.robots.ros2.ros_robot import connect

        if self.depth_stop is not None and not 0 < self.depth_stop <= 5:
            raise OptionError(f"--depth-stop must be a distance above 0 and up to 5 m, got {self.depth_stop}.")
        profile, link = connect(self.robot, node="ltvn_guard")
        with link:
            guard = Guard(link, profile, depth_stop_m=self.depth_stop)
            _LOG.info("Guarding %s: %s to %s.", profile.name, profile.driving.guard_topic, profile.topics.command)
            with suppress(KeyboardInterrupt):
                guard.run(lambda: False)
        return GuardSummary(guard.forwarded, guard.refused)
