"""The simulated robot as one of ROS 2 in this process, where nobody can kill it, and when its wheels last turned."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.served_robot import ServedRobot
from ltvn_core.robots.ros2.zenoh_link import ZenohLink
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_viz.verbs.robot_processes import PROFILE
from tests.waiting import until

SCENE = "apartment-57"
MOVED = 1e-3
"""Metres or radians between two looks; a robot that stands does not move at all."""
QUIET_S = 0.6
"""Who has not moved for so long stands."""


class Body:
    """Knows when it moved last."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._pose = robot.exact_pose
        self.moved_s = time.monotonic()
        self.over = threading.Event()

    def look(self) -> bool:
        """Note whether it moved; return whether it is over."""
        pose, now_s = self._robot.exact_pose, time.monotonic()
        if np.abs(pose - self._pose).max() > MOVED:
            self._pose, self.moved_s = pose, now_s
        return self.over.is_set()

    @property
    def moves(self) -> bool:
        return time.monotonic() - self.moved_s < 0.15

    def stands_after(self, since_s: float) -> float:
        """Wait until it stands, and return how long after a moment it last moved, in seconds."""
        until(lambda: time.monotonic() - max(self.moved_s, since_s) > QUIET_S)
        return max(0.0, self.moved_s - since_s)


@contextmanager
def served_body(address: str) -> Iterator[Body]:
    profile = open_profile(PROFILE)
    robot = open_simulation(SCENE, seed=0).robot
    with ZenohLink.connect(address, node="ltvn_simulator") as link:
        served, body = ServedRobot(robot, link, profile), Body(robot)
        thread = threading.Thread(target=served.run, args=(body.look,))
        thread.start()
        try:
            yield body
        finally:
            body.over.set()
            thread.join()
            robot.close()
