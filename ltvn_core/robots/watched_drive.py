"""The images of a drive that somebody else steers: those at which the robot has moved. Owns how far; drives nothing."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from ltvn_core.geometry import relative
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, Observation, Pose

IMAGE_EVERY_M = 0.12
"""On a mapping drive an image is taken after this distance,"""
IMAGE_EVERY_RAD = math.radians(10)
"""or after this change of heading (both ours)."""


def watch_drive(robot: Robot, is_over: Callable[[], bool]) -> Iterator[Observation]:
    """Yield the first image, and one after every 12 cm or 10 degrees by odometry, until it is over."""
    last: Observation | None = None
    while not is_over():
        seen = robot.observe()
        if last is None or has_moved(last.odometry, seen.odometry, by_m=IMAGE_EVERY_M, by_rad=IMAGE_EVERY_RAD):
            last = seen
            yield seen
        robot.clock.advance(CONTROL_STEP_S)


def has_moved(before: Pose, now: Pose, *, by_m: float, by_rad: float) -> bool:
    """Tell whether a pose (3,) is so far from another one, or turned by so much."""
    ahead, aside, turned = relative(before, now)
    return bool(np.hypot(ahead, aside) >= by_m or abs(turned) >= by_rad)
