"""A robot with a bad camera. Body, clock and odometry are the robot's own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.evaluation.perturbations.geometry_perturbations import FrameLoss
from ltvn_core.evaluation.perturbations.perturbation_registry import DROPPED_FRAMES, open_perturbation
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


class PerturbedRobot:
    """Passes everything on to a robot and makes worse what it sees. Implements `ltvn_core.robots.robot.Robot`.

    A frame that is lost leaves the picture of the last one that arrived, with the odometry of now.
    """

    def __init__(self, robot: Robot, perturbations: Sequence[str], *, seed: int) -> None:
        """Look through all of `perturbations` at once, names of `PERTURBATIONS`; `seed` draws what varies."""
        names = [name for name in perturbations if name != DROPPED_FRAMES]
        self._robot = robot
        self._seed = seed
        self._perturbations = [open_perturbation(name, robot.spec.camera) for name in names]
        self._loss = FrameLoss() if DROPPED_FRAMES in perturbations else None
        self._taken: Observation | None = None
        self._shown: Observation | None = None
        self._lost = False

    @property
    def spec(self) -> RobotSpec:
        """The robot's."""
        return self._robot.spec

    @property
    def clock(self) -> Clock:
        """The robot's."""
        return self._robot.clock

    def observe(self) -> Observation:
        """Take an image and make it worse; an image that the robot returns twice is the same both times."""
        taken = self._robot.observe()
        if self._shown is None or taken is not self._taken:
            self._taken = taken
            self._shown = self._perturbed(taken)
        return self._shown

    def state(self) -> RobotState:
        """Return the robot's odometry, clock and bumper."""
        return self._robot.state()

    def drive(self, twist: Twist) -> None:
        """Pass the command on."""
        self._robot.drive(twist)

    def stop(self) -> None:
        """Stop the robot."""
        self._robot.stop()

    def _perturbed(self, taken: Observation) -> Observation:
        rng = np.random.default_rng([self._seed, abs(taken.step)])
        last = self._shown
        if self._loss is not None and last is not None:
            self._lost = self._loss.is_lost(rng, was_lost=self._lost)
            if self._lost:
                return replace(taken, rgb=last.rgb, depth=last.depth, original=last.original)
        for perturbation in self._perturbations:
            taken = perturbation(taken, rng)
        return taken
