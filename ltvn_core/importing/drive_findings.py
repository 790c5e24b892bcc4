"""What is known of a drive once it was read: the frames that were kept, without pictures, and numbers about them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.importing.drive_odometry import OdometrySource
from ltvn_core.importing.drive_statistics import (
    Coverage,
    Drift,
    TiltRange,
    coverage,
    drift,
    gaps_s,
    tilt_range,
)
from ltvn_core.importing.frame_preparation import FramePreparation
from ltvn_core.importing.raw_frame import DriveFacts
from ltvn_core.types import Pose, Tilt

_MEASURED = ("rgb", "depth", "odometry", "truth")
TOO_LITTLE_MOTION = "too little motion"
"""The one reason to leave an image out that says nothing against it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeptFrame:
    """A frame of the recording, without its pictures."""

    stamp: float
    pose: Pose
    """(3,): the odometry that was recorded."""
    odometry: Pose | None
    """(3,): the source's own."""
    truth: Pose | None
    """(3,)."""
    tilt: Tilt | None
    depth_median_m: float | None
    """Of the pixels with depth; None without a depth image, NaN where it holds none."""

    @property
    def has_depth(self) -> bool:
        """Whether it has a depth image."""
        return self.depth_median_m is not None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriveFindings:
    """What is known of a drive once it was read."""

    frames: int
    dropped_as_wrong: int
    """Images that were left out for another reason than too little motion."""
    thinned: int
    """Images that were left out for too little motion."""
    is_spacing_ignored: bool
    """Somebody said after how many metres or degrees to keep an image, and there is no odometry to measure them by."""
    with_depth: int
    depth_median_m: float | None
    """Half of the depth is nearer, half is farther; None without any."""
    used_streams: Sequence[str]
    """Images and poses in use, by role and name."""
    possible_depths: Sequence[str]
    """Streams that could be depth and were not used."""
    is_lens_known: bool
    is_depth_registered: bool
    odometry: OdometrySource
    poses: Pose
    """(N, 3) by the odometry that was recorded."""
    width_px: int
    """Of the recorded images."""
    field_of_view_rad: float
    """Horizontal."""
    tilt: TiltRange | None
    coverage: Coverage | None
    """By the poses; None without any."""
    drift: Drift | None
    gaps_s: Sequence[float]


def drive_findings(
    frames: Sequence[KeptFrame],
    stamps: Sequence[float],
    dropped: Mapping[str, int],
    *,
    facts: DriveFacts,
    odometry: OdometrySource,
    is_spacing_ignored: bool,
    preparation: FramePreparation,
    camera: CameraModel,
) -> DriveFindings:
    """Return what is known of a drive from its kept frames and the stamps of all its images in order."""
    poses = np.array([frame.pose for frame in frames])
    has_poses = odometry is not OdometrySource.NONE
    return DriveFindings(
        frames=len(frames),
        dropped_as_wrong=sum(count for reason, count in dropped.items() if reason != TOO_LITTLE_MOTION),
        thinned=dropped.get(TOO_LITTLE_MOTION, 0),
        is_spacing_ignored=is_spacing_ignored,
        with_depth=sum(frame.has_depth for frame in frames),
        depth_median_m=_depth_median_m(frames),
        used_streams=[f"{stream.role} {stream.name}" for stream in facts.streams if stream.role in _MEASURED],
        possible_depths=[stream.name for stream in facts.streams if stream.could_be == "depth"],
        is_lens_known=preparation.is_lens_known,
        is_depth_registered=preparation.is_depth_registered,
        odometry=odometry,
        poses=poses,
        width_px=camera.width,
        field_of_view_rad=camera.horizontal_fov_rad,
        tilt=tilt_range([frame.tilt for frame in frames if frame.tilt is not None]),
        coverage=coverage(poses, np.array([frame.stamp for frame in frames])) if has_poses else None,
        drift=_drift(frames),
        gaps_s=gaps_s(np.array(stamps)).tolist(),
    )


def _depth_median_m(frames: Sequence[KeptFrame]) -> float | None:
    medians = [each.depth_median_m for each in frames if each.depth_median_m is not None]
    known = [median for median in medians if not math.isnan(median)]
    return float(np.median(known)) if known else None


def _drift(frames: Sequence[KeptFrame]) -> Drift | None:
    both = [(each.odometry, each.truth) for each in frames if each.odometry is not None and each.truth is not None]
    if len(both) < 2:
        return None
    odometry, truth = (np.array(poses) for poses in zip(*both, strict=True))
    return drift(odometry, truth)
