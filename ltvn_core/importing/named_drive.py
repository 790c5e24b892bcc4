"""A recorded drive as a person names it in place of a robot: its path, or PROFILE@PATH where a profile knows more.

Owns what a profile adds: which topics are the robot's, how its camera is mounted, and how large it is.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.importing.reader_registry import open_drive
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.robots.ros2.profile import RobotProfile, open_profile

_FROM_TREE = "tf"


class NamedDrive(NamedTuple):
    """A drive on disk, and what is known of the robot that recorded it."""

    path: Path
    profile: RobotProfile | None = None

    @classmethod
    def find(cls, wanted: str) -> Self | None:
        """Return the drive of that name; None where no such file or folder exists. Raises RobotError."""
        if Path(wanted).exists():
            return None if wanted.endswith(".py") else cls(Path(wanted))
        name, at, place = wanted.rpartition("@")
        return cls(Path(place), open_profile(name)) if at and place and Path(place).exists() else None

    def open(self) -> DriveReader:
        """Open it for reading, by the topics of the profile. Raises DriveError."""
        return open_drive(self.path, options=None if self.profile is None else _options(self.profile))

    def mounted(self, raw: RawFrame) -> RawFrame:
        """Return a frame whose camera sits as the profile says."""
        if self.profile is None or raw.camera is None:
            return raw
        return replace(raw, camera=self.profile.mounted(raw.camera), tilt=None)

    def spec(self, camera: CameraModel) -> RobotSpec:
        """Return what the toolkit asks of a robot, whose images `camera` takes; a LoCoBot's size without a profile."""
        spec = LOCOBOT if self.profile is None else self.profile.spec(camera)
        return replace(spec, name=f"{self.path.name} (recorded)", camera=camera)


def _options(profile: RobotProfile) -> ReadOptions:
    topics = profile.topics
    return ReadOptions(
        rgb=topics.colour,
        depth=topics.depth,
        odometry=topics.odometry or _FROM_TREE,
        camera_info=topics.camera_info,
    )
