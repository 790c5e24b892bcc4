"""What compares the images of an open recording: the predictor that its images or its map ask for.

Owns when that is another than the robot's, and keeps those that were opened. The choice itself is
`ltvn_core.predictors.choice`'s.
"""

import logging
from typing import NamedTuple

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import have_same_rays
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError
from ltvn_core.predictors.choice import ImageSource, PredictorChoice
from ltvn_core.predictors.opening import open_method, open_predictor
from ltvn_core.predictors.registry import NETWORK
from ltvn_core.recording.metadata import RecordingMetadata
from ltvn_core.systems.registry import open_system
from ltvn_core.types import Predictor
from ltvn_viz.session.options import AppOptions

logger = logging.getLogger(__name__)


class ReplayMethod(NamedTuple):
    """How the images of a recording are compared."""

    predictor: Predictor
    method: Method
    """The thresholds, with the constants measured for the predictor."""


class ReplayMethods:
    """Opens predictors for recordings, each once. Use it in the worker's thread alone."""

    def __init__(self, options: AppOptions, robots: Predictor) -> None:
        """Take the options, with the predictor by its own name, and the one that looks through the robot's camera."""
        self._options = options
        self._robots = robots
        self._opened: dict[str, ReplayMethod] = {}

    def of(self, meta: RecordingMetadata) -> ReplayMethod | None:
        """Return what compares a recording's images.

        None stands for what the robot uses, which also serves where the recording's own cannot be opened here.
        """
        try:
            choice = ImageSource.of(meta).choose()
            return None if self._is_the_robots(choice, meta.camera) else self._open(choice, meta)
        except LtvnError as error:
            logger.info("The images of the recording are compared as the robot's are: %s", error)
            return None

    def _is_the_robots(self, choice: PredictorChoice, camera: CameraModel) -> bool:
        if choice.name != self._options.predictor:
            return False
        # The network takes images of one camera alone, to which all others are fitted.
        return choice.name == NETWORK or have_same_rays(camera, self._robots.camera)

    def _open(self, choice: PredictorChoice, meta: RecordingMetadata) -> ReplayMethod:
        key = repr((choice.name, meta.scene, meta.camera))
        if key not in self._opened:
            options = self._options
            predictor = open_predictor(choice.name, meta.scene, options.start_weights, camera=meta.camera)
            system = open_system(options.system, open_method(options.preset, predictor))
            self._opened[key] = ReplayMethod(predictor, system.method)
        return self._opened[key]
