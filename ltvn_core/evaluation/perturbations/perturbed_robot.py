"""A robot with a bad camera. Body, clock and odometry are the robot's own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.evaluation.perturbations.geometry_perturbations import FrameLoss
from ltvn_core.evaluation.perturbations.perturbation_registry import DROPPED_FRAMES, open_perturbation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import Observation


class PerturbedRobot(RobotView):
    """Makes worse what a robot sees.

    A frame that is lost leaves the picture of the last one that arrived, with the odometry of now.
    """

    def __init__(self, robot: Robot, perturbations: Sequence[str], *, seed: int) -> None:
        """Look through all of `perturbations` at once, names of `PERTURBATIONS`; `seed` draws what varies."""
        names = [name for name in perturbations if name != DROPPED_FRAMES]
        super().__init__(robot)
        self._seed = seed
        self._perturbations = [open_perturbation(name, robot.spec.camera) for name in names]
        self._loss = FrameLoss() if DROPPED_FRAMES in perturbations else None
        self._lost = False

    def _changed(self, taken: Observation) -> Observation:
        rng = np.random.default_rng([self._seed, abs(taken.step)])
        last = self._shown
        if self._loss is not None and last is not None:
            self._lost = self._loss.is_lost(rng, was_lost=self._lost)
            if self._lost:
                return replace(taken, rgb=last.rgb, depth=last.depth, original=last.original)
        for perturbation in self._perturbations:
            taken = perturbation(taken, rng)
        return taken
