"""Choice of the predictor: the one named by the user, else the one that made the map, else the default for the images.

Owns the default. Opens no predictor.
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
"""Name that selects the map's predictor, or the default for the images."""

FOR_SIMULATED_IMAGES = NETWORK
"""Default for simulated images: it was trained on them and recognises nearly every near pair."""
FOR_REAL_IMAGES = GEOMETRIC
"""Default for real images: on real sequences it recognises several times as many near pairs as the network."""

IMPORTED = "import"
"""The `verb` in the description of a recording that was imported from another program's data."""


class PredictorChoice(NamedTuple):
    """A predictor by name, and the reason for choosing it."""

    name: str
    reason: str
    """Reason as text, for a summary."""

    def __str__(self) -> str:
        return f"{self.name} ({self.reason})"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageSource:
    """The source of the images to compare: a recording, a map or a robot."""

    camera: CameraModel
    """Camera of the recording, the map or the robot."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """Settings with which the recording was made."""
    fingerprint: str = ""
    """Fingerprint of the predictor with which the recording was made; empty if there was none."""

    @classmethod
    def of(cls, meta: RecordingMetadata) -> Self:
        """Return the source that the metadata of a recording or a map describe."""
        return cls(camera=meta.camera, config=meta.config, fingerprint=meta.fingerprint)

    def choose(self, wanted: str = AUTO) -> PredictorChoice:
        """Choose a predictor to continue a map or a run: the named one, else the one that made it.

        Raises OptionError if no predictor has that name, or if the one that made the map is not installed.
        """
        made_by = recorded_predictor(self.config, self.fingerprint)
        if wanted != AUTO or made_by is None:
            return self.choose_anew(wanted)
        require_predictor(made_by)
        return PredictorChoice(made_by, "the map was built with it")

    def choose_anew(self, wanted: str = AUTO) -> PredictorChoice:
        """Choose a predictor independently of the one that made the recording: the named one, else the default.

        Raises OptionError if no predictor has that name.
        """
        if wanted != AUTO:
            require_predictor(wanted)
            return PredictorChoice(wanted, "as asked")
        if self.config.get("verb") == IMPORTED:
            return _for_real_images("the drive was imported")
        if not have_same_rays(self.camera, LOCOBOT.camera):
            return _for_real_images(f"the camera, {self.camera.width} x {self.camera.height}, is not the simulator's")
        return PredictorChoice(FOR_SIMULATED_IMAGES, "the camera is that of its training images")


def recorded_predictor(config: Mapping[str, Any], fingerprint: str) -> str | None:
    """Return the name of the predictor that made a map; None if the file does not name it.

    Maps of earlier versions were made by the network or the oracle, but do not name it.
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
