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


_KEEP_M, _KEEP_RAD = 0.1, radians(8)
"""Distance, or change of heading, since the last kept image after which the next is kept (ours)."""
_JUMP_M, _JUMP_RAD = 1.0, radians(90)
"""Distance, or turn, in odometry between consecutive images above which it has jumped and a new piece begins (ours)."""
_FEWEST = 20
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
    observations: Sequence[Observation], name: str, *, camera: CameraModel | None = None
) -> Trajectory:
    """Select the keyframes of a drive and split it where its odometry jumps.

    Args:
        observations: The drive, in order.
        name: Name of the drive, for messages and cards.
        camera: The camera that took the images.

    Raises:
        RecordingError: There is no odometry, there are too few images, or all show one place.
    """
    odometry = _odometry(observations, name)
    jumped = odometry_jumps(odometry)
    piece = np.concatenate([[0], np.cumsum(jumped)])
    rows = _keyframe_rows(odometry, piece)
    with_depth = np.array([observations[row].has_depth for row in rows], bool)
    if with_depth.any() and not with_depth.all():  # If no image has depth, a later message is more helpful.
        missing = int((~with_depth).sum())
        log.warning("%s: %d of %d images have no depth and are not used for training.", name, missing, len(rows))
        rows = rows[with_depth]
    if len(rows) < _FEWEST:
        raise RecordingError(
            f"{name}: only {len(rows)} of {len(odometry)} images are at least {_KEEP_M:g} m or "
            f"{degrees(_KEEP_RAD):.0f} degrees apart, so all show about the same place; fine-tuning needs {_FEWEST}. "
            "Record a longer drive through the rooms."
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


def _odometry(observations: Sequence[Observation], name: str) -> Pose:
    """Return the odometry (N, 3) after checking that it exists and moves."""
    if len(observations) < _FEWEST:
        raise RecordingError(
            f"{name}: holds {len(observations)} images; fine-tuning needs {_FEWEST} or more. Record a longer "
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


def odometry_jumps(odometry: Pose) -> NDArray[np.bool_]:
    """Return a mask (N - 1,) of the steps between consecutive images at which odometry jumped."""
    driven, turned = odometry_steps(odometry)
    return (driven > _JUMP_M) | (turned > _JUMP_RAD)


def _keyframe_rows(odometry: Pose, piece: NDArray[np.integer]) -> NDArray[np.intp]:
    """Return the rows of images that are far enough from the last kept one, or begin a piece."""
    rows = [0]
    for row in range(1, len(odometry)):
        shift = odometry[row] - odometry[rows[-1]]
        far = np.hypot(shift[0], shift[1]) >= _KEEP_M or abs(wrap_angle(shift[2])) >= _KEEP_RAD
        if far or piece[row] != piece[rows[-1]]:
            rows.append(row)
    return np.array(rows, np.intp)


def _millimetres(observation: Observation) -> NDArray[np.uint16]:
    # 65 m is the largest depth in millimetres that fits in 16 bits.
    depth = observation.require_depth("fine-tuning")
    if not observation.has_depth:
        raise ImageError(
            f"Image {observation.step} and all others of the drive have no depth, and fine-tuning needs it. Is the "
            "depth camera running? Drive again with it."
        )
    return np.rint(np.clip(depth, 0, 65) * 1000).astype(np.uint16)
