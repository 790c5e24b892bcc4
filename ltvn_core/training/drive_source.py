"""A drive that a person has at hand, in a file or in memory. Owns how it becomes labelled pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training.fine_tuning_data import label_drive, read_labelled_drive
from ltvn_core.types import Observation

if TYPE_CHECKING:
    from ltvn_core.training_data.trajectory_pairs import LabelRule, TrajectoryPairs


@dataclass(frozen=True)
class DriveSource:
    """A drive to learn from."""

    name: str
    """What the card calls it."""
    source: Path | Sequence[Observation]
    """A recording, or images in the order in which they were taken."""

    def label(self, rule: "LabelRule") -> "TrajectoryPairs":
        """Label the drive's pairs of images. Raises RecordingError if it is no drive."""
        if isinstance(self.source, Path):
            return read_labelled_drive(self.source, rule)
        return label_drive(self.source, self.name, camera=LOCOBOT.camera, rule=rule)
