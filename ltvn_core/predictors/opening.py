"""Opens predictors by name, and returns the method with the constants that were measured for a predictor.

Predictors are entry points of the group `ltvn.predictors`; each is a function from a `PredictorRequest` to a predictor.
Owns the order of the names, the checks of a factory's result, and the camera with which a predictor is opened. The
default predictor is in `ltvn_core.predictors.choice`.
"""

import logging
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import cast
from weakref import ref

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import PAPER, Likelihoods, Method, preset
from ltvn_core.errors import OptionError
from ltvn_core.plugins import PREDICTORS, Plugin, find_plugins, require_own
from ltvn_core.predictors.request import PredictorFactory, PredictorRequest, predictor_card
from ltvn_core.preprocessing import ORIGINAL_SIZE
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.types import Predictor

log = logging.getLogger(__name__)

NETWORK = "network"
GEOMETRIC = "geometric"
COMPOSED = "composed"
ORACLE = "oracle"

_names: dict[int, tuple["ref[Predictor]", str]] = {}
"""The names by which the predictors that are in memory were opened, by their identity."""

OWN_PREDICTORS = (NETWORK, GEOMETRIC, ORACLE)
"""Predictors of this package, which come first in lists."""


def find_predictors() -> dict[str, Plugin]:
    """Return the installed predictors by name; nothing is imported."""
    return find_plugins(PREDICTORS, first=OWN_PREDICTORS)


def predictor_names() -> tuple[str, ...]:
    """Return the names of all predictors."""
    return tuple(find_predictors())


def require_predictor(name: str) -> Plugin:
    """Return the plug-in with a name. Raises OptionError, which lists the installed names."""
    found = find_predictors()
    if name not in found:
        require_own(PREDICTORS, name, OWN_PREDICTORS)
        raise OptionError(
            f"No predictor is called {name!r}; installed are: {', '.join(found) or 'none'}. Install the package that "
            "contains it, or name another."
        )
    return found[name]


def open_plugin(plugin: Plugin, request: PredictorRequest) -> Predictor:
    """Import a predictor's factory, call it, and check its result.

    Raises PluginError for a broken plug-in, and the factory's own errors for an invalid request.
    """
    factory = plugin.load()
    if not callable(factory):
        raise plugin.refusal("is not a function from a PredictorRequest to a Predictor")
    with plugin.running("could not be opened"):
        made = cast(PredictorFactory, factory)(request)
        check_predictor(made, plugin)
    with suppress(TypeError):  # An object without weak references keeps no name.
        _names[id(made)] = ref(made, partial(_forget, id(made))), plugin.name
    return made


def check_predictor(made: object, plugin: Plugin) -> None:
    """Raise PluginError if a part of the Protocol `Predictor` is missing."""
    missing = [name for name in ("encode", "predict") if not callable(getattr(made, name, None))]
    fingerprint = getattr(made, "fingerprint", None)
    camera = getattr(made, "camera", None)
    if not (isinstance(fingerprint, str) and fingerprint):
        missing.append("fingerprint (a text)")
    if not isinstance(camera, CameraModel):
        missing.append("camera (a CameraModel)")
    if missing:
        raise plugin.refusal(
            f"makes {type(made).__name__}, which has no {', '.join(missing)}; see ltvn_core.types.Predictor"
        )


def simulated_robot(predictor: str) -> RobotSpec:
    """Return the LoCoBot with a camera for the named predictor: key points need larger images."""
    if predictor not in (GEOMETRIC, COMPOSED):
        return LOCOBOT
    return replace(LOCOBOT, camera=LOCOBOT.camera.scaled(ORIGINAL_SIZE.long_side, ORIGINAL_SIZE.short_side))


def open_predictor(
    name: str = NETWORK,
    scene_name: str = "",
    weights: Path | str | None = None,
    *,
    camera: CameraModel = LOCOBOT.camera,
    device: str = "cpu",
) -> Predictor:
    """Return the predictor with a name.

    Args:
        name: `network`, `geometric`, `oracle`, or a name that another package adds to the entry points
            `ltvn.predictors`.
        scene_name: Scene of the images; only the oracle needs it.
        weights: Weights to use instead of the shipped ones.
        camera: Camera of the recording, the map or the robot; images larger than 320 x 240 are scaled down.
        device: Where a network computes: `cpu`, `cuda`, `mps`, or `auto` for the fastest one.

    Raises:
        OptionError: No predictor has that name; the message lists the installed ones. Or the device is missing.
        PluginError: Another package's predictor is broken.
        WeightsError: The weights are missing or damaged.
        MissingLibraryError: A library that it needs is not installed.
        SceneError: The oracle is asked about a scene that is not simulated.
    """
    path = None if weights is None else Path(weights)
    request = PredictorRequest(scene_name, path, _at_most_original_size(camera), device)
    return open_plugin(require_predictor(name), request)


def _forget(key: int, _: "ref[Predictor]") -> None:
    _names.pop(key, None)


def opened_name(predictor: Predictor) -> str:
    """Return the name by which a predictor was opened; empty if it was made in another way."""
    known, name = _names.get(id(predictor), (None, ""))
    return name if known is not None and known() is predictor else ""


def _at_most_original_size(camera: CameraModel) -> CameraModel:
    scale = ORIGINAL_SIZE.scale_of(camera.width, camera.height)
    if scale < 1:
        camera = camera.scaled(max(round(camera.width * scale), 1), max(round(camera.height * scale), 1))
    return replace(camera, depth_scale=1.0)  # Preprocessed depth is in metres.


def open_method(name: str, predictor: Predictor, *, likelihoods: Likelihoods | None = None) -> Method:
    """Return a preset with the constants of Eq. 3 and Eq. 4 that were measured for the predictor.

    `likelihoods` replace the measured ones; without either, the preset keeps its own. Raises OptionError for an unknown
    preset and WeightsError for a damaged card.
    """
    method = preset(name)
    card = predictor_card(predictor)
    if card.merge_distance is not None and method is not PAPER:
        nearest = min(card.merge_distance, method.building.merge_distance)
        method = replace(method, building=replace(method.building, merge_distance=nearest))
    constants = likelihoods or card.likelihoods
    if constants is None:
        log.info("This predictor has no measured constants, so Eq. 3 and Eq. 4 use the default ones.")
        return method
    return replace(method, believing=replace(method.believing, **asdict(constants)))
