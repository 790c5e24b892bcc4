"""Opens a predictor by its name, and the method with the constants that were measured for it.

Owns the camera that a predictor is opened for. Which predictor is taken where nobody names one is
`ltvn_core.predictors.choice`'s.
"""

import logging
from dataclasses import asdict, replace
from pathlib import Path

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import PAPER, Likelihoods, Method, preset
from ltvn_core.predictors.registry import COMPOSED, GEOMETRIC, open_plugin, require_predictor
from ltvn_core.predictors.request import PredictorRequest, predictor_card
from ltvn_core.preprocessing import ORIGINAL_SIZE
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.types import Predictor

log = logging.getLogger(__name__)


def simulated_robot(predictor: str) -> RobotSpec:
    """Return the LoCoBot with a camera that suits the predictor of that name: key points need a larger picture."""
    if predictor not in (GEOMETRIC, COMPOSED):
        return LOCOBOT
    return replace(LOCOBOT, camera=LOCOBOT.camera.scaled(ORIGINAL_SIZE.long_side, ORIGINAL_SIZE.short_side))


def open_predictor(
    name: str, scene_name: str = "", weights: Path | None = None, *, camera: CameraModel = LOCOBOT.camera
) -> Predictor:
    """Return the predictor of that name.

    Args:
        name: `network`, `geometric`, `oracle`, or what another package adds to the entry points `ltvn.predictors`.
        scene_name: Where the images are taken; it matters to the oracle alone.
        weights: Weights to use instead of the shipped ones.
        camera: Of the recording, the map or the robot; an image larger than 320 x 240 is made smaller.

    Raises:
        OptionError: No predictor has that name; the message lists those there are.
        PluginError: Another package's predictor is broken.
        WeightsError: The weights are missing or damaged.
        MissingLibraryError: A library that it needs is not installed.
        SceneError: The oracle is asked about a scene that is not simulated.
    """
    return open_plugin(require_predictor(name), PredictorRequest(scene_name, weights, _at_most_original_size(camera)))


def _at_most_original_size(camera: CameraModel) -> CameraModel:
    scale = ORIGINAL_SIZE.scale_of(camera.width, camera.height)
    if scale < 1:
        camera = camera.scaled(max(round(camera.width * scale), 1), max(round(camera.height * scale), 1))
    return replace(camera, depth_scale=1.0)  # Depth has come through the door and is in metres.


def open_method(name: str, predictor: Predictor, *, likelihoods: Likelihoods | None = None) -> Method:
    """Return a preset whose constants of Eq. 3 and Eq. 4 are those measured for the predictor.

    `likelihoods` win over measured ones; where nothing was measured the preset's own stay. Raises OptionError for an
    unknown preset and WeightsError for a damaged card.
    """
    method = preset(name)
    card = predictor_card(predictor)
    if card.merge_distance is not None and method is not PAPER:
        nearest = min(card.merge_distance, method.building.merge_distance)
        method = replace(method, building=replace(method.building, merge_distance=nearest))
    constants = likelihoods or card.likelihoods
    if constants is None:
        log.info(
            "Nobody measured this predictor; Eq. 3 and Eq. 4 use general constants. `ltvn measure --write` does it for "
            "weights."
        )
        return method
    return replace(method, believing=replace(method.believing, **asdict(constants)))
