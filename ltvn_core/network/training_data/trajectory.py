"""A recorded drive as training data: its selected images, split where odometry jumps."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import ImageError, RecordingError
from ltvn_core.geometry import wrap_angle
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation, Pose

log = logging.getLogger(__name__)

REACHABLE = 1
UNREACHABLE = 0
UNKNOWN = -1


@dataclass(frozen=True, slots=True)
class KeyframeSelection:
    """Thresholds for the selection of keyframes, and for splitting a drive at jumps (all values are ours)."""

    keep_m: float = 0.1
    """Distance since the last kept image after which the next is kept, in metres."""
    keep_rad: float = radians(8)
    """Change of heading since the last kept image after which the next is kept, in radians."""
    jump_m: float = 1.0
    """Distance in odometry between consecutive images above which it has jumped and a new piece begins, in metres."""
    jump_rad: float = radians(90)
    """Turn in odometry between consecutive images above which it has jumped and a new piece begins, in radians."""
    fewest: int = 20
    """Least number of kept images; a drive with fewer is refused."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The N kept images of a drive in the order in which they were taken."""

    name: str
    rgb: NDArray[np.uint8]
    """(N, H, W, 3) colours."""
    depth_mm: NDArray[np.uint16]
    """(N, H, W) depth in millimetres; 0 where missing."""
    poses: Pose
    """(N, 3) poses by odometry, which drifts; comparable within one piece only."""
    piece: NDArray[np.int32]
    """(N,) number of the piece of each image."""
    travelled_m: NDArray[np.float64]
    """(N,) metres driven so far."""
    turned_rad: NDArray[np.float64]
    """(N,) radians turned so far, to either side."""
    camera: CameraModel
    """Camera of the images."""

    @property
    def pieces(self) -> int:
        """Return the number of pieces."""
        return int(self.piece[-1]) + 1


def select_keyframes(
    observations: Sequence[Observation],
    name: str,
    *,
    camera: CameraModel | None = None,
) -> Trajectory:
    """Select the keyframes of a drive and split it where its odometry jumps.

    Args:
        observations: The drive, in order.
        name: Name of the drive, for messages and cards.
        camera: The camera that took the images.

    Raises:
        RecordingError: There is no odometry, there are too few images, or all show one place.
    """
    selection = KeyframeSelection()
    odometry = _odometry(observations, name, selection)
    jumped = odometry_jumps(odometry, selection)
    piece = np.concatenate([[0], np.cumsum(jumped)])
    rows = _rows_with_depth(_keyframe_rows(odometry, piece, selection), observations, name)
    if len(rows) < selection.fewest:
        raise RecordingError(
            f"{name}: only {len(rows)} of {len(odometry)} images are at least {selection.keep_m:g} m or "
            f"{degrees(selection.keep_rad):.0f} degrees apart, so all show about the same place; fine-tuning needs "
            f"{selection.fewest}. Record a longer drive through the rooms."
        )
    driven, turned = odometry_steps(odometry)
    kept = [observations[row] for row in rows]
    return Trajectory(
        name=name,
        rgb=np.stack([each.rgb for each in kept]),
        depth_mm=np.stack([_millimetres(each) for each in kept]),
        poses=odometry[rows],
        piece=piece[rows].astype(np.int32) - piece[rows[0]],
        travelled_m=np.concatenate([[0], np.cumsum(driven * ~jumped)])[rows],
        turned_rad=np.concatenate([[0], np.cumsum(turned * ~jumped)])[rows],
        camera=camera or LOCOBOT.camera,
    )


def _odometry(observations: Sequence[Observation], name: str, selection: KeyframeSelection) -> Pose:
    """Return the odometry (N, 3) after checking that it exists and moves."""
    if len(observations) < selection.fewest:
        raise RecordingError(
            f"{name}: holds {len(observations)} images; fine-tuning needs {selection.fewest} or more. Record a longer "
            "drive, for instance with `ltvn app` or `ltvn collect`."
        )
    odometry = np.stack([np.asarray(each.odometry, np.float64) for each in observations])
    missing = ~np.isfinite(odometry).all(1)
    if missing.any() or np.ptp(odometry, axis=0).max() == 0:
        reason = f"{int(missing.sum())} of the poses are missing" if missing.any() else "it does not change"
        raise RecordingError(
            f"{name}: fine-tuning takes the poses of its {len(odometry)} images from odometry, and {reason}. Record "
            "the drive again with the robot's wheel odometry connected."
        )
    return odometry


def odometry_steps(odometry: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return metres and radians (N - 1,) from each image to the next."""
    moved = np.diff(odometry, axis=0)
    return np.hypot(moved[:, 0], moved[:, 1]), np.abs(wrap_angle(moved[:, 2]))


def odometry_jumps(odometry: Pose, selection: KeyframeSelection) -> NDArray[np.bool_]:
    """Return a mask (N - 1,) of the steps between consecutive images at which odometry jumped."""
    driven, turned = odometry_steps(odometry)
    return (driven > selection.jump_m) | (turned > selection.jump_rad)


def _keyframe_rows(odometry: Pose, piece: NDArray[np.integer], selection: KeyframeSelection) -> NDArray[np.intp]:
    """Return the rows of images that are far enough from the last kept one, or begin a piece."""
    rows = [0]
    for row in range(1, len(odometry)):
        shift = odometry[row] - odometry[rows[-1]]
        far = np.hypot(shift[0], shift[1]) >= selection.keep_m or abs(wrap_angle(shift[2])) >= selection.keep_rad
        if far or piece[row] != piece[rows[-1]]:
            rows.append(row)
    return np.array(rows, np.intp)


def _rows_with_depth(rows: NDArray[np.intp], observations: Sequence[Observation], name: str) -> NDArray[np.intp]:
    """Leave out the images without depth, and log how many they are; a drive without any depth keeps them all."""
    seen = np.array([observations[row].has_depth for row in rows], bool)
    if seen.all() or not seen.any():
        return rows  # If no image has depth, a later message about the camera is more helpful.
    log.warning("%s: %d of %d images have no depth and are not used for training.", name, int((~seen).sum()), len(rows))
    return rows[seen]


def _millimetres(observation: Observation) -> NDArray[np.uint16]:
    # 65 m is the largest depth in millimetres that fits in 16 bits.
    depth = observation.require_depth("fine-tuning")
    if not observation.has_depth:
        raise ImageError(
            f"Image {observation.step} and all others of the drive have no depth, and fine-tuning needs it. Is the "
            "depth camera running? Drive again with it."
        )
    return np.rint(np.clip(depth, 0, 65) * 1000).astype(np.uint16)
