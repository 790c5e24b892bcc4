"""Statistics of a drive while it is read: frames, poses, tilts, gaps, and the expected map.

Owns the arithmetic on poses and stamps. `import_summary` decides which numbers are doubtful.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ltvn_core.config import ROBUST
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.import_options import OdometrySource
from ltvn_core.data.importing.raw_frame import DriveFacts, RawFrame
from ltvn_core.data.importing.stamped_lists import period_s
from ltvn_core.data.revisits import near_pairs, revisits
from ltvn_core.geometry import distance, relative, rigid_fit
from ltvn_core.graph.bridges import REACH
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.types import Observation, Pose, Tilt

GAP_PERIODS = 5.0
GAP_S = 1.0
"""Least length of a gap in seconds; a gap is also longer than `GAP_PERIODS` times the usual time between two images."""
TOO_LITTLE_MOTION = "too little motion"
"""The only reason for leaving out an image that does not mean a fault of the image."""
STAMP_NOT_AFTER = "stamp not after the one before"
NO_ODOMETRY = "no odometry at that time"
NO_TRUTH = "no true pose at that time"
MOST_NAMES = 10
"""Largest number of streams that a message names."""
_EVERY_PIXEL = 4
"""Step in pixels between the samples for the median of depth."""
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


@dataclass(slots=True, eq=False, kw_only=True)
class DriveStatistics:
    """What was found in a drive and left out; grows with each frame of the recording."""

    facts: DriveFacts
    odometry: OdometrySource
    """Source of the recorded odometry."""
    preparation: FramePreparation
    """The preparation of its frames, which knows camera and lens."""
    stamps: Sequence[float]
    """Stamps of all images in order, also of those that were left out."""
    is_spacing_ignored: bool = False
    """Whether the user gave a spacing of images although the drive has no odometry to measure it."""
    dropped: Mapping[str, int] = field(default_factory=dict)
    """Images that were left out, by reason."""

    _observed: list[tuple[float, Pose]] = field(default_factory=list)
    _compared: list[tuple[Pose, Pose]] = field(default_factory=list)
    _tilts: list[Tilt] = field(default_factory=list)
    _depth_medians_m: list[float] = field(default_factory=list)
    with_depth: int = 0
    """Number of images with depth."""
    has_odometry: bool = False
    """Whether an image has odometry of the source, used or not."""
    nearest_m: float = math.inf
    farthest_m: float = 0.0
    """Smallest and largest number of the source's depth images, in metres; the smallest is 0 if a pixel has none."""

    def observe(self, seen: Observation, raw: RawFrame) -> None:
        """Take an image of the recording, and the frame of the source that it was made of."""
        self._observed.append((seen.stamp, seen.odometry))
        self.has_odometry |= raw.odometry is not None
        if raw.odometry is not None and raw.truth is not None:
            self._compared.append((raw.odometry, raw.truth))
        if raw.tilt is not None:
            self._tilts.append(raw.tilt)
        if seen.depth is not None:
            self.with_depth += 1
            sparse = seen.depth[::_EVERY_PIXEL, ::_EVERY_PIXEL]
            if (sparse > 0).any():
                self._depth_medians_m.append(float(np.median(sparse[sparse > 0])))
        if raw.depth_m is not None:
            sparse = np.nan_to_num(raw.depth_m[::_EVERY_PIXEL, ::_EVERY_PIXEL], nan=0.0, posinf=0.0, neginf=0.0)
            self.nearest_m = min(self.nearest_m, float(sparse.min()))
            self.farthest_m = max(self.farthest_m, float(sparse.max()))

    @property
    def frames(self) -> int:
        """Number of images of the recording."""
        return len(self._observed)

    @property
    def poses(self) -> Pose:
        """Poses (N, 3) by the recorded odometry."""
        return np.array([pose for _, pose in self._observed])

    @property
    def usual_pitch_rad(self) -> float | None:
        """Median pitch of the camera in radians; None without any tilt."""
        return float(np.median([tilt.pitch_rad for tilt in self._tilts])) if self._tilts else None

    @property
    def depth_median_m(self) -> float | None:
        """Median depth of the drive, in metres; None if no image has depth."""
        return float(np.median(self._depth_medians_m)) if self._depth_medians_m else None

    @property
    def used_streams(self) -> str:
        """Names of the image and pose streams in use, each with its role."""
        found = [f"{stream.role} {stream.name}" for stream in self.facts.streams if stream.role in _MEASURED]
        return ", ".join(found[:MOST_NAMES]) or "images alone"

    @property
    def gaps_s(self) -> Sequence[float]:
        """Lengths in seconds of the unusually long pauses between images."""
        pauses = np.diff(self.stamps)
        return pauses[pauses > max(GAP_S, GAP_PERIODS * (period_s(self.stamps) or 0.0))].tolist()

    @property
    def tilt(self) -> TiltRange | None:
        """Range of the camera's tilt; None without any tilt."""
        if not self._tilts:
            return None
        pitch, roll = np.degrees(np.array(self._tilts)).T
        return TiltRange(
            pitch_median_deg=float(np.median(pitch)),
            pitch_lowest_deg=float(pitch.min()),
            pitch_highest_deg=float(pitch.max()),
            roll_largest_deg=float(np.percentile(np.abs(roll), 95)),
        )

    @property
    def drift(self) -> Drift | None:
        """Deviation of odometry from the true poses; None without both, or if the drive is too short."""
        pairs = np.array(self._compared)
        return drift(pairs[:, 0], pairs[:, 1]) if len(pairs) >= 2 else None

    @property
    def coverage(self) -> Coverage | None:
        """Coverage computed from the poses; None if there are no poses."""
        stamps = np.array([stamp for stamp, _ in self._observed])
        return None if self.odometry is OdometrySource.NONE else coverage(self.poses, stamps)

    @property
    def path_m(self) -> float:
        """Length of the path by the recorded odometry, in metres."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum()) if self.frames > 1 else 0.0


def coverage(poses: Pose, stamps: NDArray[np.float64]) -> Coverage:
    """Return the expected map of N images with these poses (N, 3) and stamps (N,)."""
    near = near_pairs(poses)
    # Odometry may join images that are close in time and space in a map without a match.
    breaks = np.hypot(*np.diff(poses[:, :2], axis=0).T) > JUMP_M if len(poses) > 1 else np.zeros(0, bool)
    breaks |= np.diff(stamps) > PAUSE_S
    stretch = np.concatenate([[0], np.cumsum(breaks)])
    pairs = [near]
    for gap in range(1, min(REACH, len(poses) - 1) + 1):
        apart = distance(relative(poses[:-gap], poses[gap:]))
        rows = np.flatnonzero((apart < ROBUST.building.connect_distance) & (stretch[:-gap] == stretch[gap:]))
        pairs.append(np.column_stack([rows, rows + gap]))
    joined = np.concatenate(pairs)
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(poses), len(poses)))
    pieces, labels = connected_components(graph, directed=False)
    return Coverage(
        pieces=int(pieces),
        largest_share=float(np.bincount(labels).max() / len(poses)),
        revisited_share=len(np.unique(revisits(near, poses, stamps)[:, 1])) / len(poses),
    )


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
