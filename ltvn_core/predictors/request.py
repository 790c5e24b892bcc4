"""What a predictor plug-in is asked for, and what it says of itself."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeAlias

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Predictor


class PredictorRequest(NamedTuple):
    """What a predictor is opened for. A factory takes of it what it can use."""

    scene: str = ""
    """Name or path of the scene; empty where there is none, or nobody says. Only who may know the truth needs it."""
    weights: Path | None = None
    """Weights to use instead of the predictor's own."""
    camera: CameraModel = LOCOBOT.camera
    """The camera of the recording, the map or the robot, at most 320 x 240, with depth in metres. A predictor that can
    work with any camera takes this one as its own, so that images need not be rectified."""


PredictorFactory: TypeAlias = Callable[[PredictorRequest], Predictor]
"""What an entry point of the group `ltvn.predictors` names."""


class PredictorCard(NamedTuple):
    """What a predictor says of itself."""

    fingerprint: str
    """Changes whenever the same images give other numbers; maps remember it."""
    camera: CameraModel
    """The camera whose images it takes."""
    needs_depth: bool
    """Whether it can compare nothing without depth."""
    likelihoods: Likelihoods | None
    """The constants of Eq. 3 and Eq. 4 as they were measured for it; None where nobody measured them."""
    merge_distance: float | None
    """Greatest D_m for maps built with it: nodes may not be farther apart than it recognises most images. None where
    it sees as far as D_c."""
    least_width_px: int
    """In narrower images it finds too little; 0 where none is too narrow."""


def predictor_card(predictor: Predictor) -> PredictorCard:
    """Return what a predictor says of itself; all but the first two may be left out.

    Raises WeightsError where the constants beside weights are damaged.
    """
    return PredictorCard(
        fingerprint=predictor.fingerprint,
        camera=predictor.camera,
        needs_depth=bool(getattr(predictor, "needs_depth", False)),
        likelihoods=getattr(predictor, "likelihoods", None),
        merge_distance=getattr(predictor, "merge_distance", None),
        least_width_px=int(getattr(predictor, "least_width_px", 0)),
    )
