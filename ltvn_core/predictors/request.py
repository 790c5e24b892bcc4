"""The request with which a predictor plug-in is opened, and the card that describes a predictor."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeAlias

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Predictor


class PredictorRequest(NamedTuple):
    """Arguments for opening a predictor. A factory ignores those that it cannot use."""

    scene: str = ""
    """Name or path of the scene; empty if none or unknown. Only a predictor that uses ground truth needs it."""
    weights: Path | None = None
    """Weights to use instead of the predictor's own."""
    camera: CameraModel = LOCOBOT.camera
    """The camera of the recording, the map or the robot, at most 320 x 240, with depth in metres. A predictor for any
    camera uses this one as its own, so that images need not be rectified."""
    device: str = "cpu"
    """Where a network computes: cpu, cuda, mps or auto."""


PredictorFactory: TypeAlias = Callable[[PredictorRequest], Predictor]
"""Type of an entry point of the group `ltvn.predictors`."""


class PredictorCard(NamedTuple):
    """Properties of a predictor."""

    fingerprint: str
    """Identifier that changes whenever the same images give other results; stored in maps."""
    camera: CameraModel
    """Camera of its input images."""
    needs_depth: bool
    """Whether it needs depth for every comparison."""
    likelihoods: Likelihoods | None
    """Constants of Eq. 3 and Eq. 4 that were measured for it; None if they were not measured."""
    merge_distance: float | None
    """Largest D_m for maps built with it, the distance within which it recognises most images; None if that is at least
    D_c."""
    least_width_px: int
    """Least useful image width in pixels; 0 if it works with any width."""
    device: str
    """Kind of device that computes, on which the last bits of answers depend."""


def predictor_card(predictor: Predictor) -> PredictorCard:
    """Return the properties of a predictor; it must have the first two, and defaults replace the others.

    Raises WeightsError if the constants beside weights are damaged.
    """
    return PredictorCard(
        fingerprint=predictor.fingerprint,
        camera=predictor.camera,
        needs_depth=bool(getattr(predictor, "needs_depth", False)),
        likelihoods=getattr(predictor, "likelihoods", None),
        merge_distance=getattr(predictor, "merge_distance", None),
        least_width_px=int(getattr(predictor, "least_width_px", 0)),
        device=str(getattr(predictor, "device", "cpu")),
    )
