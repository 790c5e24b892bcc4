"""Statistics of a drive after reading: frames, poses, tilts, gaps, and the expected map.

Owns the arithmetic on poses and stamps. `import_summary` decides which numbers are doubtful.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import ROBUST
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.import_options import OdometrySource
from ltvn_core.data.importing.raw_frame import DriveFacts
from ltvn_core.data.importing.revisits import near_pairs, revisits
from ltvn_core.data.importing.stamped_lists import period_s
from ltvn_core.geometry import distance, relative, rigid_fit
from ltvn_core.graph.bridges import REACH
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.types import Pose, Tilt

GAP_PERIODS = 5.0
GAP_S = 1.0
"""Least length of a gap in seconds; a gap is also longer than `GAP_PERIODS` times the usual time between two images."""
TOO_LITTLE_MOTION = "too little motion"
"""The only reason for leaving out an image that does not mean a fault of the image."""
STAMP_NOT_AFTER = "stamp not after the one before"
NO_ODOMETRY = "no odometry at that time"
NO_TRUTH = "no true pose at that time"
_MEASURED = ("rgb", "depth", "odometry", "truth")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Deviation of odometry from the true poses."""

    position_rmse_m: float
    """RMSE of the position over the whole drive, after the best alignment with the truth."""
    per_metre: float
    """Median position error over stretches of about a metre, as a share of the path length."""
    yaw_deg_per_metre: float
    """Error of the heading over stretches of about a metre, in degrees per metre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRange:
    """Range of a camera's tilt over a drive, in degrees; positive values mean upwards, and right side down."""

    pitch_median_deg: float
    pitch_lowest_deg: float
    pitch_highest_deg: float
    roll_largest_deg: float
    """95th percentile of the absolute roll, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """Expected connectivity of a map of a drive, if all near images are joined, and consecutive images by odometry."""

    pieces: int
    """Number of pieces: no chain of joined images leads from one piece to another."""
    largest_share: float
    """Share of the images that are in the largest piece."""
    revisited_share: float
    """Share of the images at a place where the drive had been before."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeptFrame:
    """A frame of the recording, without its images."""

    stamp: float
    pose: Pose
    """Recorded odometry, (3,)."""
    odometry: Pose | None
    """Odometry of the source, (3,); None if it has none."""
    truth: Pose | None
    """True pose, (3,); None if it is unknown."""
    tilt: Tilt | None
    depth_median_m: float | None
    """Median over the pixels with depth, in metres; None without a depth image, NaN if the image has no depth."""
    depth_range_m: tuple[float, float] | None = None
    """Smallest and largest number of the source's depth image, in metres; the smallest is 0 if a pixel has no depth."""

    @property
    def has_depth(self) -> bool:
        """Whether the frame has a depth image."""
        return self.depth_median_m is not None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DriveStatistics:
    """Statistics of a drive after reading."""

    frames: int
    dropped_as_wrong: Mapping[str, int]
    """Images that were left out for another reason than too little motion, by reason."""
    thinned: int
    """Images that were left out for too little motion."""
    is_spacing_ignored: bool
    """Whether the user gave a spacing of images although the drive has no odometry to measure it."""
    with_depth: int
    depth_median_m: float | None
    """Median depth of the drive, in metres; None if no image has depth."""
    depth_range_m: tuple[float, float] | None
    """Smallest and largest number of all depth images, as in `KeptFrame`."""
    used_streams: Sequence[str]
    """Names of the image and pose streams in use, each with its role."""
    facts: DriveFacts
    is_lens_known: bool
    is_depth_registered: bool
    odometry: OdometrySource
    poses: Pose
    """Poses (N, 3) by the recorded odometry."""
    width_px: int
    """Width of the recorded images, in pixels."""
    field_of_view_rad: float
    """Horizontal field of view, in radians."""
    tilt: TiltRange | None
    coverage: Coverage | None
    """Coverage computed from the poses; None if there are no poses."""
    drift: Drift | None
    gaps_s: Sequence[float]


def drive_statistics(
    frames: Sequence[KeptFrame],
    stamps: Sequence[float],
    dropped: Mapping[str, int],
    *,
    facts: DriveFacts,
    odometry: OdometrySource,
    is_spacing_ignored: bool,
    preparation: FramePreparation,
    camera: CameraModel,
) -> DriveStatistics:
    """Return the statistics of a drive from its kept frames and the stamps of all its images in order."""
    poses = np.array([frame.pose for frame in frames])
    has_poses = odometry is not OdometrySource.NONE
    return DriveStatistics(
        frames=len(frames),
        dropped_as_wrong={reason: count for reason, count in dropped.items() if reason != TOO_LITTLE_MOTION},
        thinned=dropped.get(TOO_LITTLE_MOTION, 0),
        is_spacing_ignored=is_spacing_ignored,
        with_depth=sum(frame.has_depth for frame in frames),
        depth_median_m=_depth_median_m(frames),
        depth_range_m=_depth_range_m(frames),
        used_streams=[f"{stream.role} {stream.name}" for stream in facts.streams if stream.role in _MEASURED],
        facts=facts,
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


def _depth_range_m(frames: Sequence[KeptFrame]) -> tuple[float, float] | None:
    ranges = [frame.depth_range_m for frame in frames if frame.depth_range_m is not None]
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None


def _drift(frames: Sequence[KeptFrame]) -> Drift | None:
    both = [(each.odometry, each.truth) for each in frames if each.odometry is not None and each.truth is not None]
    if len(both) < 2:
        return None
    odometry, truth = (np.array(poses) for poses in zip(*both, strict=True))
    return drift(odometry, truth)


def path_m(poses: Pose) -> float:
    """Return the length of a path through poses (N, 3)."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()) if len(poses) > 1 else 0.0


def coverage(poses: Pose, stamps: NDArray[np.float64]) -> Coverage:
    """Return the expected map of N images with these poses (N, 3) and stamps (N,)."""
    near = near_pairs(poses)
    joined = np.concatenate([near, _bridged_pairs(poses, stamps)])
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(poses), len(poses)))
    pieces, labels = connected_components(graph, directed=False)
    return Coverage(
        pieces=int(pieces),
        largest_share=float(np.bincount(labels).max() / len(poses)),
        revisited_share=len(np.unique(revisits(near, poses, stamps)[:, 1])) / len(poses),
    )


def _bridged_pairs(poses: Pose, stamps: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows (K, 2) of images, close in time and space, that odometry may join in a map without a match."""
    breaks = np.hypot(*np.diff(poses[:, :2], axis=0).T) > JUMP_M if len(poses) > 1 else np.zeros(0, bool)
    breaks |= np.diff(stamps) > PAUSE_S
    stretch = np.concatenate([[0], np.cumsum(breaks)])
    pairs = [np.empty((0, 2), np.intp)]
    for gap in range(1, min(REACH, len(poses) - 1) + 1):
        apart = distance(relative(poses[:-gap], poses[gap:]))
        rows = np.flatnonzero((apart < ROBUST.building.connect_distance) & (stretch[:-gap] == stretch[gap:]))
        pairs.append(np.column_stack([rows, rows + gap]))
    return np.concatenate(pairs)


def drift(odometry: Pose, truth: Pose) -> Drift | None:
    """Compare odometry with truth, both (N, 3); None if the drive is too short for a comparison."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    ends = np.searchsorted(way, way + 1.0)
    starts = np.flatnonzero(ends < len(way))
    if not len(starts):
        return None
    ends = ends[starts]
    gap = relative(relative(truth[starts], truth[ends]), relative(odometry[starts], odometry[ends]))
    stretch_m = way[ends] - way[starts]
    return Drift(
        position_rmse_m=rigid_fit(odometry[:, :2], truth[:, :2]).error_m,
        per_metre=float(np.median(np.hypot(gap[:, 0], gap[:, 1]) / stretch_m)),
        yaw_deg_per_metre=float(np.degrees(np.median(np.abs(gap[:, 2]) / stretch_m))),
    )


def tilt_range(tilts: Sequence[Tilt]) -> TiltRange | None:
    """Return the range of the camera's tilt; None without any tilt."""
    if not tilts:
        return None
    pitch, roll = np.degrees(np.array(tilts)).T
    return TiltRange(
        pitch_median_deg=float(np.median(pitch)),
        pitch_lowest_deg=float(pitch.min()),
        pitch_highest_deg=float(pitch.max()),
        roll_largest_deg=float(np.percentile(np.abs(roll), 95)),
    )


def gaps_s(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths in seconds of the unusually long pauses between N images in order."""
    pauses = np.diff(stamps)
    return pauses[pauses > max(GAP_S, GAP_PERIODS * (period_s(stamps) or 0.0))]
