"""Where the odometry of a drive comes from: what a person wants, and what the drive has."""

from enum import StrEnum

import numpy as np

from ltvn_core.errors import DriveError
from ltvn_core.importing.raw_frame import DriveReader, FrameMoment
from ltvn_core.types import Pose


class OdometrySource(StrEnum):
    """Where the recorded odometry comes from."""

    AUTO = "auto"
    """The source's odometry, else its true poses, else none."""
    SOURCE = "source"
    TRUTH = "truth"
    NONE = "none"

    def pose(self, moment: FrameMoment) -> Pose | None:
        """Return the pose (3,) of a moment, zeros where there is to be none; None where it is missing."""
        match self:
            case OdometrySource.TRUTH:
                return moment.truth
            case OdometrySource.NONE:
                return np.zeros(3)
            case OdometrySource.SOURCE | OdometrySource.AUTO:
                return moment.odometry


def chosen_odometry(reader: DriveReader, wanted: OdometrySource = OdometrySource.AUTO) -> OdometrySource:
    """Return where odometry is to come from. Raises DriveError where the source has none of the wanted kind."""
    roles = {stream.role for stream in reader.facts.streams}
    offered = {OdometrySource.SOURCE: "odometry", OdometrySource.TRUTH: "truth"}
    if wanted is OdometrySource.AUTO:
        return next((source for source, role in offered.items() if role in roles), OdometrySource.NONE)
    if wanted in offered and offered[wanted] not in roles:
        found = ", ".join(sorted(roles)) or "nothing"
        raise DriveError(
            f"--odometry-from {wanted}: the drive has no {offered[wanted]}; found {found}. Leave the option out to "
            "take what there is."
        )
    return wanted
