"""`ltvn guard`: forwards only fresh commands to a robot's wheels."""

import logging
from contextlib import suppress
from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.robots.ros2.guard import Guard
from ltvn_core.robots.ros2.ros_robot import split_address
from ltvn_core.robots.ros2.zenoh_link import ZenohLink
from ltvn_core.verbs.guard import GuardVerb
from ltvn_core.verbs.verb import Summary

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class GuardSummary:
    """Summary when the guard has ended, and the robot stands still."""

    forwarded: int
    """Number of forwarded commands."""
    refused: int
    """Number of refused commands: late, out of order, not finite, from a second sender, or without a stop after
    silence."""


def guard_robot(options: GuardVerb) -> Summary:
    """Guard until interrupted; raises OptionError and RobotError."""
    if options.depth_stop is not None and not 0 < options.depth_stop <= 5:
        raise OptionError(f"--depth-stop must be a distance above 0 and up to 5 m, got {options.depth_stop}.")
    profile, address = split_address(options.robot)
    with ZenohLink.connect(address, node="ltvn_guard", domain=profile.domain) as link:
        guard = Guard(link, profile, depth_stop_m=options.depth_stop)
        _LOG.info("Guarding %s: %s to %s.", profile.name, profile.driving.guard_topic, profile.topics.command)
        with suppress(KeyboardInterrupt):
            guard.run(lambda: False)
    return GuardSummary(guard.forwarded, guard.refused)
