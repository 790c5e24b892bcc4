"""Options of an import, and the choice of its source of odometry."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import chain, islice

import numpy as np

from ltvn_core.data.importing.raw_frame import DriveReader, FrameMoment, RawFrame
from ltvn_core.errors import DriveError, OptionError
from ltvn_core.types import Pose

EVERY_M, EVERY_DEG = 0.1, 8.0
"""Default spacing of kept images, in metres and degrees."""
_LOOKED_AT = 20
"""Number of images among which odometry is looked for that the reader's facts do not name."""


class OdometrySource(StrEnum):
    """Source of the recorded odometry."""

    AUTO = "auto"
    """The source's odometry, else its true poses, else none."""
    SOURCE = "source"
    TRUTH = "truth"
    NONE = "none"

    def pose(self, moment: FrameMoment) -> Pose | None:
        """Return the pose (3,) of a moment; zeros if no odometry is used, None if the pose is missing."""
        match self:
            case OdometrySource.TRUTH:
                return moment.truth
            case OdometrySource.NONE:
                return np.zeros(3)
            case OdometrySource.SOURCE | OdometrySource.AUTO:
                return moment.odometry


_ROLES = {OdometrySource.SOURCE: "odometry", OdometrySource.TRUTH: "truth"}


def has_odometry(reader: DriveReader, wanted: OdometrySource) -> bool:
    """Tell whether the reader's facts name the wanted odometry; always for a kind that no drive must have."""
    return wanted not in _ROLES or any(stream.role == _ROLES[wanted] for stream in reader.facts.streams)


def chosen_odometry(
    reader: DriveReader, carried: Iterable[FrameMoment], wanted: OdometrySource = OdometrySource.AUTO
) -> OdometrySource:
    """Return the source of odometry, by the reader's facts and by what its first frames carry.

    Raises DriveError where the drive has none of the wanted kind.
    """
    roles = {stream.role for stream in reader.facts.streams if stream.role}
    for moment in carried:
        roles |= {role for role, pose in (("odometry", moment.odometry), ("truth", moment.truth)) if pose is not None}
    if wanted is OdometrySource.AUTO:
        return next((source for source, role in _ROLES.items() if role in roles), OdometrySource.NONE)
    if wanted in _ROLES and _ROLES[wanted] not in roles:
        found = ", ".join(sorted(roles)) or "nothing"
        if unread := [stream.described for stream in reader.facts.unread("odometry")]:
            found += f"; not read: {', '.join(unread)}"
        raise DriveError(
            f"--odometry-from {wanted}: the drive has no {_ROLES[wanted]}; found {found}. Omit the option to use "
            "what the drive has."
        )
    return wanted


def frames_with_odometry(
    reader: DriveReader, wanted: OdometrySource = OdometrySource.AUTO
) -> tuple[OdometrySource, Iterator[RawFrame]]:
    """Return the source of odometry, and all frames of a drive.
    Looks at the first frames, until one carries odometry, and chooses. Raises DriveError as `chosen_odometry`.
    """
    frames = reader.frames()
    first: list[RawFrame] = []
    if not has_odometry(reader, OdometrySource.SOURCE):
        for frame in islice(frames, _LOOKED_AT):
            first.append(frame)
            if frame.odometry is not None:
                break
    return chosen_odometry(reader, map(FrameMoment.of, first), wanted), chain(first, frames)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How raw frames become a recording. Raises OptionError for an invalid number."""

    odometry: OdometrySource = OdometrySource.AUTO
    every_m: float = EVERY_M
    """Distance after which an image is kept, in metres; with 0 for both limits, all images are kept."""
    every_deg: float = EVERY_DEG
    """Change of heading or tilt after which an image is kept, in degrees."""
    fov_deg: float | None = None
    """Horizontal field of view in degrees, for a camera that the source does not describe."""
    height_m: float | None = None
    """Height of the camera above the floor in metres; None takes it from the source."""
    pitch_deg: float | None = None
    """Pitch of the mounted camera in degrees, upwards positive; None takes it from the source."""
    scene: str = ""
    """Name of the place in the recording; if empty, it is made from the source's name."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (0 <= self.every_m < math.inf and 0 <= self.every_deg < math.inf):
            raise OptionError(f"--every-m and --every-deg must be 0 or more, got {self.every_m} and {self.every_deg}.")
        if self.height_m is not None and not 0 <= self.height_m < 100:
            raise OptionError(f"--height must be in metres above the floor, got {self.height_m}.")
        if self.pitch_deg is not None and not abs(self.pitch_deg) < 90:
            raise OptionError(f"--pitch must be between -90 and 90 degrees from level, got {self.pitch_deg}.")

    @property
    def has_own_spacing(self) -> bool:
        """Whether the spacing of kept images was given."""
        return (self.every_m, self.every_deg) != (EVERY_M, EVERY_DEG)
