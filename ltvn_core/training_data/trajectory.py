"""A recorded drive as training data: selected images with their odometry, split where odometry jumps.

`ltvn_core.training_data.trajectory_pairs` labels the pairs of its images. Exact poses are never read.
"""

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


@dataclass(frozen=True, slots=True)
class KeyframeSelection:
    """Which images of a drive are kept, and where it is split (all values are ours)."""

    keep_m: float = 0.1
    """An image is kept after this distance since the last one,"""
    keep_rad: float = radians(8)
    """or after this change of heading."""
    jump_m: float = 1.0
    """Odometry that moves more than this between two recorded images has jumped, and a new piece begins;"""
    jump_rad: float = radians(90)
    """likewise where it turns by more than this."""
    fewest: int = 20
    """A drive with fewer kept images is refused."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The N kept images of a drive in the order in which they were taken."""

    name: str
    rgb: NDArray[np.uint8]
    """(N, H, W, 3)"""
    depth_mm: NDArray[np.uint16]
    """(N, H, W); 0 = no return."""
    poses: Pose
    """(N, 3) poses by odometry, which drifts; comparable within one piece only."""
    piece: NDArray[np.int32]
    """(N,) number of the piece that an image belongs to."""
    travelled_m: NDArray[np.float64]
    """(N,) metres driven so far."""
    turned_rad: NDArray[np.float64]
    """(N,) radians turned so far, to either side."""
    camera: CameraModel
    """The camera that took them."""

    @property
    def pieces(self) -> int:
        """Return how many pieces there are."""
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
            f"{name}: of {len(odometry)} images only {len(rows)} are at least {selection.keep_m:g} m or "
            f"{degrees(selection.keep_rad):.0f} degrees apart, so all show about one place; fine-tuning needs "
            f"{selection.fewest}. Drive on through the rooms and record that."
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
        reason = f"{int(missing.sum())} of them have none" if missing.any() else "it is the same for all of them"
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
    """Tell between which images (N - 1,) the odometry jumped."""
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
        return rows  # Where none has depth the message about the camera is the better one.
    log.warning("%s: %d of %d images have no depth and teach nothing.", name, int((~seen).sum()), len(rows))
    return rows[seen]


def _millimetres(observation: Observation) -> NDArray[np.uint16]:
    # 65 m is the most that 16 bits hold in millimetres.
    depth = observation.require_depth("fine-tuning")
    if not observation.has_depth:
        raise ImageError(
            f"Image {observation.step} and all others of the drive have no depth, and fine-tuning needs it. Is the "
            "depth camera running? Drive again with it."
        )
    return np.rint(np.clip(depth, 0, 65) * 1000).astype(np.uint16)
