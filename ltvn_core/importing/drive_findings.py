"""What is known of a drive once it was read: numbers about its frames and poses, and what is doubtful of them.

Owns the arithmetic on poses and stamps, the limits of what is doubtful, and what to do about it. Refuses nothing.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import ROBUST
from ltvn_core.findings import Finding
from ltvn_core.geometry import compose, distance, relative, wrap_angle
from ltvn_core.graph.bridges import REACH
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.graph.revisits import NEAR_M, near_pairs, revisits
from ltvn_core.importing.drive_odometry import OdometrySource
from ltvn_core.importing.frame_preparation import ASSUMED_FOV_DEG, FramePreparation
from ltvn_core.importing.raw_frame import DriveFacts
from ltvn_core.importing.source_camera import HOW_TO, HOW_TO_SCALE
from ltvn_core.importing.stamp_matching import period_s
from ltvn_core.types import Pose, Tilt

GAP_PERIODS = 5.0
GAP_S = 1.0
"""A pause between two images is a gap when it is longer than both."""
STEEP_DEG = 20.0
"""A predictor that looks level sees less than two thirds of a picture that is tilted by more."""
ROLLED_DEG = 60.0
"""No robot carries a camera that is rolled by more, if it holds it upright at all."""
NARROW_PX = 160
"""In narrower images the geometric predictor, which real ones are compared by, finds too little."""
NEAREST_MEDIAN_M = 0.1
FARTHEST_MEDIAN_M = 10.0
"""Half of what a depth camera sees from a robot is farther than the first and nearer than the second."""
MUCH_DRIFT = 0.15
FEW_FRAMES = 20
MANY_GAPS = 3
TOO_LITTLE_MOTION = "too little motion"
"""The one reason to leave an image out that says nothing against it."""
_MEASURED = ("rgb", "depth", "odometry", "truth")
_MOST_NAMES = 10
_KEEP_ALL = "--every-m 0 --every-deg 0 keeps every image."
_APART_SHARE = 0.1
_DROPPED_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """How far odometry strays from the true poses."""

    position_rmse_m: float
    """Of the whole drive, laid over the truth as well as possible."""
    per_metre: float
    """Median error over stretches of a metre or so, as a share of the way."""
    yaw_deg_per_metre: float
    """The same of the heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltRange:
    """How a camera was tilted over a drive, in degrees; upwards and right side down are positive."""

    pitch_median_deg: float
    pitch_lowest_deg: float
    pitch_highest_deg: float
    roll_largest_deg: float
    """95 % of the images are rolled by less, to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """What a map of the drive would be like at best: all near images joined, and by odometry those in a row."""

    pieces: int
    """Parts that no chain of such images joins."""
    largest_share: float
    """Share of the images in the largest of them."""
    revisited_share: float
    """Share of the images that show a place where the drive had been before."""


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
class DriveStatistics:
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
    """Return what is known of a drive from its kept frames and the stamps of all its images in order."""
    poses = np.array([frame.pose for frame in frames])
    has_poses = odometry is not OdometrySource.NONE
    return DriveStatistics(
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


def path_m(poses: Pose) -> float:
    """Return the length of a way through poses (N, 3)."""
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()) if len(poses) > 1 else 0.0


def coverage(poses: Pose, stamps: NDArray[np.float64]) -> Coverage:
    """Return what a map of N images with these poses (N, 3) and stamps (N,) would be like."""
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
    """Return the rows (K, 2) of images that odometry alone may join in a map, because the robot drove between them."""
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
    """Compare odometry with truth, both (N, 3); None where the drive is too short to say."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    ends = np.searchsorted(way, way + 1.0)
    starts = np.flatnonzero(ends < len(way))
    if not len(starts):
        return None
    ends = ends[starts]
    gap = relative(relative(truth[starts], truth[ends]), relative(odometry[starts], odometry[ends]))
    stretch_m = way[ends] - way[starts]
    return Drift(
        position_rmse_m=_aligned_rmse_m(odometry, truth),
        per_metre=float(np.median(np.hypot(gap[:, 0], gap[:, 1]) / stretch_m)),
        yaw_deg_per_metre=float(np.degrees(np.median(np.abs(gap[:, 2]) / stretch_m))),
    )


def _aligned_rmse_m(odometry: Pose, truth: Pose) -> float:
    """Return the root mean square distance after the best rigid alignment in the plane (Umeyama, 1991)."""
    from_middle, to_middle = odometry[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    left, right = odometry[:, :2] - from_middle, truth[:, :2] - to_middle
    cross = (left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0]).sum()
    turn = np.array([0.0, 0.0, math.atan2(cross, float((left * right).sum()))])
    turned = compose(turn, np.column_stack([left, np.zeros(len(left))]))[:, :2]
    return float(np.sqrt(((turned - right) ** 2).sum(axis=1).mean()))


def tilt_range(tilts: Sequence[Tilt]) -> TiltRange | None:
    """Return how the camera was tilted; None without any tilt."""
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
    """Return the lengths in seconds of the pauses between N images in order that are longer than usual."""
    pauses = np.diff(stamps)
    return pauses[pauses > max(GAP_S, GAP_PERIODS * (period_s(stamps) or 0.0))]


def drive_findings(drive: DriveStatistics) -> Iterator[Finding]:
    """Yield what is doubtful of a drive, with the likely cause and what to do."""
    for check in (_camera, _depth, _tilt, _odometry, _frames, _overlap, _dropped):
        yield from check(drive)


def _camera(drive: DriveStatistics) -> Iterator[Finding]:
    if not drive.is_lens_known:
        yield Finding(
            f"Nothing says what lens took the images; {ASSUMED_FOV_DEG:.0f} degrees were assumed, and distances will "
            f"be wrong by as much as that is: {HOW_TO}."
        )
    if drive.width_px < NARROW_PX:
        yield Finding(
            f"The images are {drive.width_px} pixels wide, and in less than {NARROW_PX} hardly anything is recognised; "
            "a map of them may know a small part of the drive.",
            remedy="Record larger images where the camera can.",
        )


def _depth(drive: DriveStatistics) -> Iterator[Finding]:
    if not drive.is_depth_registered:
        yield Finding(
            "The depth images are not registered to the colours; they were laid over them by the two lenses alone, and "
            "lie a few centimetres off.",
            remedy="Name a registered stream by --depth where there is one.",
        )
    if not drive.with_depth:
        yield _no_depth(drive)
    elif drive.with_depth < drive.frames:
        missing = drive.frames - drive.with_depth
        yield Finding(f"{missing} of {drive.frames} images have no depth, and are not used where it is needed.")
    median_m = drive.depth_median_m
    if median_m is not None and not NEAREST_MEDIAN_M <= median_m <= FARTHEST_MEDIAN_M:
        side = "nearer" if median_m < NEAREST_MEDIAN_M else "farther"
        yield Finding(
            f"Half of the depth is {side} than {median_m:.3g} m, where {NEAREST_MEDIAN_M:g} to {FARTHEST_MEDIAN_M:g} m "
            f"are usual, so its unit is probably another: {HOW_TO_SCALE}."
        )


def _no_depth(drive: DriveStatistics) -> Finding:
    less = "predictors that need it cannot use this drive, and the others estimate distances less well."
    if drive.possible_depths:
        names = ", ".join(drive.possible_depths[:_MOST_NAMES])
        return Finding(f"No depth was used: {less}", remedy=f"It could be in {names}; name the right one by --depth.")
    used = ", ".join(drive.used_streams[:_MOST_NAMES]) or "images alone"
    remedy = "Record the depth camera too where the robot has one."
    return Finding(f"There is no depth among {used}: {less}", remedy=remedy)


def _tilt(drive: DriveStatistics) -> Iterator[Finding]:
    tilt = drive.tilt
    if tilt is not None and abs(tilt.pitch_median_deg) > STEEP_DEG:
        way = "down" if tilt.pitch_median_deg < 0 else "up"
        yield Finding(
            f"The camera looks {way} by {abs(tilt.pitch_median_deg):.0f} degrees; a predictor for a level camera sees "
            "little of such images.",
            remedy="Use `--predictor geometric`, or mount the camera nearly level.",
        )
    if tilt is not None and tilt.roll_largest_deg > ROLLED_DEG:
        yield Finding(
            f"By its poses the camera rolls by up to {tilt.roll_largest_deg:.0f} degrees, and pitches from "
            f"{tilt.pitch_lowest_deg:.0f} to {tilt.pitch_highest_deg:.0f}.",
            remedy="If the quaternions are written with w first, write them as qx qy qz qw; if the poses are of the "
            "robot's body, turn them to the camera's optical frame (x right, y down, z forward).",
        )


def _odometry(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.odometry is OdometrySource.NONE:
        yield Finding(
            "There is no odometry, so all images are recorded at one place: distances between them are what the "
            "predictor says, and nothing contradicts it.",
            remedy="Give odometry by --odometry where the robot has some.",
        )
    if drive.is_spacing_ignored:
        yield Finding(
            "--every-m and --every-deg were ignored, for without odometry nobody knows how far the camera moved: an "
            "image was kept where the picture had changed.",
            remedy=_KEEP_ALL,
        )
    if drive.odometry is OdometrySource.TRUTH:
        yield Finding(
            "There is no odometry of its own; the true poses stand in for it, so a map of this drive is better than "
            "wheels would make it."
        )
    if drive.drift is not None and drive.drift.per_metre > MUCH_DRIFT:
        yield Finding(
            f"Odometry strays from the true poses by {drive.drift.per_metre:.0%} of the way; is it in metres, of the "
            "same robot, and turned as x forward, y left?"
        )


def _frames(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.frames < FEW_FRAMES:
        text = f"Only {drive.frames} images are left; a map needs a drive of some metres."
        yield Finding(text, remedy=_thinned(drive))
    if len(drive.gaps_s) >= MANY_GAPS or sum(drive.gaps_s) > MANY_GAPS * 10:
        yield Finding(
            f"For {len(drive.gaps_s)} times, {sum(drive.gaps_s):.0f} s in all, no images came; did the recorder lose "
            "messages?"
        )


def _overlap(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.coverage is None or drive.frames < 2:
        return
    steps = np.diff(drive.poses, axis=0)
    apart = np.hypot(steps[:, 0], steps[:, 1]) > NEAR_M
    apart |= np.abs(wrap_angle(steps[:, 2])) > drive.field_of_view_rad / 2
    if apart.mean() > _APART_SHARE:
        yield Finding(
            f"{apart.sum()} of {len(apart)} images in a row do not overlap with the one before: farther than {NEAR_M} "
            "m, or turned by more than half of what the camera sees.",
            remedy=f"Drive slower, or record more images a second. {_thinned(drive)}".rstrip(),
        )
    if drive.coverage.pieces > 1:
        yield Finding(
            f"By its poses the drive falls into {drive.coverage.pieces} pieces, the largest with "
            f"{drive.coverage.largest_share:.0%} of the images, and a map will fall apart likewise, for neither near "
            "images nor odometry join them. Do the gaps or jumps belong there?",
            remedy="Drive the missing ways, and come back to where you began.",
        )


def _thinned(drive: DriveStatistics) -> str:
    """Return how more of the images are kept; nothing where none was left out for that."""
    if not drive.thinned:
        return ""
    if drive.odometry is OdometrySource.NONE:
        return f"{drive.thinned} were left out because the picture had hardly changed. {_KEEP_ALL}"
    return f"{drive.thinned} were left out for too little motion; lower --every-m and --every-deg to keep more."


def _dropped(drive: DriveStatistics) -> Iterator[Finding]:
    if drive.dropped_as_wrong > _DROPPED_SHARE * (drive.frames + drive.dropped_as_wrong):
        yield Finding(
            f"{drive.dropped_as_wrong} images could not be used, see `dropped` for the reasons; is the file cut, or "
            "were its streams recorded by different clocks?"
        )
