"""Stand-ins for a simulator or network that is not there, so that recordings can be watched without them.

Own the sentence that says what is missing. They do nothing else.
"""

from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from ltvn_core.config import Likelihoods
from ltvn_core.errors import LtvnError, SceneError
from ltvn_core.robots.robot import WallClock
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Features, Observation, Pose, Prediction, RobotState, Twist
from ltvn_viz.session.camera_feed import FeedImage

NO_PREDICTOR = "none"
"""Fingerprint of a predictor that is not there."""


class AbsentRobot:
    """A robot that stands for ever. Implements `ltvn_core.robots.robot.Robot`."""

    spec = LOCOBOT
    clock = WallClock()

    def __init__(self, why: LtvnError) -> None:
        """Remember why there is no robot."""
        self._why = why

    def observe(self) -> Observation:
        """Raise SceneError."""
        raise SceneError(f"There is no robot to drive: {self._why}")

    def state(self) -> RobotState:
        """Stand nowhere: at NaN, which is not drawn."""
        return RobotState(np.full(3, np.nan), stamp=0.0, step=0, bumper_pressed=False)

    def drive(self, twist: Twist) -> None:
        """Raise SceneError."""
        raise SceneError(f"There is no robot to drive: {self._why}")

    def stop(self) -> None:
        """Stand."""


class AbsentPredictor:
    """A network that can compare nothing. Implements `ltvn_core.types.Predictor`."""

    fingerprint = NO_PREDICTOR
    camera = LOCOBOT.camera

    def __init__(self, why: LtvnError, likelihoods: Likelihoods | None = None) -> None:
        """Remember why there is no network, and what was measured of it."""
        self._why = why
        self.likelihoods = likelihoods

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Raise the error."""
        self._refuse()

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Raise the error."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise self._why


class AbsentFeed:
    """A camera without pictures."""

    def latest_image(self, pose: Pose) -> FeedImage:
        """Return no picture."""
        return FeedImage(None, 0.0, 0)
