"""Which predictor is taken: the one that a person names, the one that made a map, or else the better one.

Owns the default. Opens nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import have_same_rays
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.predictors.opening import GEOMETRIC, NETWORK, ORACLE, predictor_names, require_predictor
from ltvn_core.robots.robot_spec import LOCOBOT

AUTO = "auto"
"""Stands for the default of the camera or of the map."""

FOR_SIMULATED_IMAGES = NETWORK
"""It learned from simulation, where it finds nearly every near pair."""
FOR_REAL_IMAGES = GEOMETRIC
"""On real sequences it finds several times as many of the near pairs as the network does."""

IMPORTED = "import"
"""The `verb` in the description of a recording that was made from another program's data."""


class PredictorChoice(NamedTuple):
    """A predictor by name, and why this one."""

    name: str
    reason: str
    """In words, for a summary."""

    def __str__(self) -> str:
        return f"{self.name} ({self.reason})"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSource:
    """Where the images come from that a predictor is to compare."""

    camera: CameraModel
    """Of the recording, the map or the robot."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """What the recording says of how it was made."""
    fingerprint: str = ""
    """Of the predictor with which it was made; empty where there was none."""

    @classmethod
    def of(cls, meta: RecordingMetadata) -> Self:
        """Take what a recording or a map says of itself."""
        return cls(camera=meta.camera, config=meta.config, fingerprint=meta.fingerprint)

    def choose(self, wanted: str = AUTO) -> PredictorChoice:
        """Choose a predictor to go on with a map or a run: unless a person names one, the one that made it.

        Raises OptionError where no predictor has that name, or where the one that made it is not installed here.
        """
        made_by = recorded_predictor(self.config, self.fingerprint)
        if wanted != AUTO or made_by is None:
            return self.choose_anew(wanted)
        require_predictor(made_by)
        return PredictorChoice(made_by, "it made the map")

    def choose_anew(self, wanted: str = AUTO) -> PredictorChoice:
        """Choose a predictor whatever made the recording: the one that a person names, else the better one.

        Raises OptionError where no predictor has that name.
        """
        if wanted != AUTO:
            require_predictor(wanted)
            return PredictorChoice(wanted, "as asked")
        if self.config.get("verb") == IMPORTED:
            return _for_real_images("the drive was imported")
        if not have_same_rays(self.camera, LOCOBOT.camera):
            return _for_real_images(f"the camera, {self.camera.width} x {self.camera.height}, is not the simulator's")
        return PredictorChoice(FOR_SIMULATED_IMAGES, "the camera is the one that it learned with")


def recorded_predictor(config: Mapping[str, Any], fingerprint: str) -> str | None:
    """Return the name of the predictor that made a map; None where the file says nothing of one.

    Maps of earlier versions were made by the network or the oracle and do not say so.
    """
    if (named := config.get("predictor")) is not None:
        return str(named)
    if not fingerprint:
        return None
    return ORACLE if fingerprint == ORACLE else NETWORK


def _for_real_images(reason: str) -> PredictorChoice:
    if FOR_REAL_IMAGES not in predictor_names():
        return PredictorChoice(FOR_SIMULATED_IMAGES, f"{reason}, but {FOR_REAL_IMAGES} is not installed")
    return PredictorChoice(FOR_REAL_IMAGES, reason)
