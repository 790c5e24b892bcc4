"""Poses in space, (4, 4), and their reduction to a pose in the plane, a tilt and a height.

Owns the conventions of frames: the optical frame (x right, y down, z forward) and the body frame (x forward, y left, z
up), in a world whose z is up. Also owns a camera's mounting on a robot (height, tilt and quarter turns), and the
decision whether the tilt of an image differs from the mounting.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Pose, Tilt

BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation (3, 3) from the optical frame (right, down, forward) to the body frame (forward, left, up)."""
OPTICAL_FROM_GRAPHICS = np.diag([1.0, -1.0, -1.0, 1.0])
"""Pose (4, 4) of the optical frame in the camera frame of OpenGL and ARKit (x right, y up, z backwards)."""

_WORST_PITCH = np.radians(89.0)
"""Largest pitch in radians; a camera that looks straight up or down has no heading, so its pitch is limited to this."""
Transform = NDArray[np.float64]
"""Pose (4, 4), which transforms points of a child frame to its parent frame."""
_RIGID_TOLERANCE = 0.02
"""Tolerance for rotations, because files contain rounded numbers."""
LOWEST_M = 0.02
"""Height in metres below which a camera is at the origin of its frames, so its height is unknown."""
_SAME_TILT_RAD = np.radians(0.5)


class SpatialPose(NamedTuple):
    """Pose of a camera in a world whose z is up."""

    planar: Pose
    """Pose (3,) in the plane: x, y, and the heading of the optical axis."""
    tilt: Tilt
    """Pitch and roll, with the conventions of `CameraModel`."""
    height_m: float
    """Height (z) in metres."""


def spatial_pose(position: ArrayLike, rotation: ArrayLike) -> SpatialPose:
    """Convert a pose in space to a pose in the plane, a tilt and a height.

    Args:
        position: (3,) metres in the world.
        rotation: (3, 3): takes directions of the camera's *optical* frame to the world. For a body frame such as
            `base_link`, hand in `rotation @ BODY_FROM_OPTICAL`.
    """
    x, y, z = np.asarray(position, np.float64)
    body: NDArray[np.float64] = np.asarray(rotation, np.float64) @ BODY_FROM_OPTICAL.T
    forward = body[:, 0]
    left = body[:, 1]
    up = body[:, 2]
    pitch = np.clip(np.arcsin(np.clip(forward[2], -1.0, 1.0)), -_WORST_PITCH, _WORST_PITCH)
    return SpatialPose(
        planar=np.array([x, y, np.arctan2(forward[1], forward[0])]),
        tilt=Tilt(pitch_rad=float(pitch), roll_rad=float(np.arctan2(left[2], up[2]))),
        height_m=float(z),
    )


def transform(translation: ArrayLike, quaternion: ArrayLike) -> Transform | None:
    """Return a pose (4, 4) from a translation (3,) in metres and a quaternion (4,) x, y, z, w; None if they are
    invalid."""
    place = np.asarray(translation, np.float64)
    turn = np.asarray(quaternion, np.float64)
    if not (np.all(np.isfinite(place)) and np.all(np.isfinite(turn))) or np.linalg.norm(turn) < 1e-6:
        return None
    result = np.eye(4)
    result[:3, :3] = Rotation.from_quat(turn / np.linalg.norm(turn)).as_matrix()
    result[:3, 3] = place
    return result


def inverse(pose: Transform) -> Transform:
    """Return the inverse: the pose of the parent in the child's frame."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def are_rotations(turns: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]:
    """Tell (...) which matrices (..., 3, 3) of finite numbers are rotations, without mirroring or stretching."""
    errors = np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3)).max(axis=(-2, -1))
    return np.asarray((errors < tolerance) & (np.linalg.det(turns) > 0))


def pose_between(positions: NDArray[np.float64], turns: Rotation, share: float) -> Transform:
    """Interpolate between two poses: position linearly, rotation along the shortest path.

    Args:
        positions: (2, 3) metres in the parent frame.
        turns: Two of them, from the child frame to the parent frame.
        share: 0 at the first pose, 1 at the second.
    """
    result = np.eye(4)
    result[:3, :3] = Slerp([0.0, 1.0], turns)(share).as_matrix()
    result[:3, 3] = (1 - share) * positions[0] + share * positions[1]
    return result


def is_rigid(matrix: Transform) -> bool:
    """Tell whether a matrix (4, 4) is finite, has a rotation without mirroring or stretching, and ends in 0, 0, 0,
    1."""
    if not np.isfinite(matrix).all():
        return False
    is_rotation = bool(are_rotations(matrix[:3, :3], _RIGID_TOLERANCE))
    return is_rotation and bool(np.abs(matrix[3] - [0, 0, 0, 1]).max() < _RIGID_TOLERANCE)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraMounting:
    """Mounting of a camera on its robot."""

    camera_on_robot: Transform
    """Pose (4, 4) of the optical frame in the robot's frame; if unknown, at its origin and looking ahead."""
    tilt: Tilt | None = None
    """Tilt of the upright image while the robot is level; None if it is unknown."""
    quarter_turns: int = 0
    """Number of quarter turns that make the images upright; see `CameraModel`."""
    height_m: float = 0.0
    """Height above the ground in metres; 0 if it is unknown."""

    @classmethod
    def unknown(cls) -> Self:
        """Return the mounting of an unknown camera."""
        camera_on_robot = np.eye(4)
        camera_on_robot[:3, :3] = BODY_FROM_OPTICAL
        return cls(camera_on_robot=camera_on_robot)

    @classmethod
    def of(cls, camera_on_robot: Transform) -> Self:
        """Return the mounting of a camera from the pose (4, 4) of its optical frame in the robot's frame."""
        seen = spatial_pose(camera_on_robot[:3, 3], camera_on_robot[:3, :3])
        turns = round(-seen.tilt.roll_rad / (np.pi / 2)) % 4
        return cls(
            camera_on_robot=camera_on_robot,
            tilt=_upright(seen.tilt, turns),
            quarter_turns=turns,
            height_m=seen.height_m if seen.height_m > LOWEST_M else 0.0,
        )

    def own_tilt(self, tilt: Tilt) -> Tilt | None:
        """Return the tilt of an image after the quarter turns; None if it equals the tilt of the mounting."""
        upright = _upright(tilt, self.quarter_turns)
        usual = self.tilt or Tilt(0.0, 0.0)
        apart = max(abs(upright.pitch_rad - usual.pitch_rad), abs(_wrapped(upright.roll_rad - usual.roll_rad)))
        return None if apart < _SAME_TILT_RAD else upright

    def mounted(self, lens: CameraModel) -> CameraModel:
        """Return a camera with this mounting; a camera that already has a mounting is returned unchanged."""
        if any((lens.height_m, lens.pitch_rad, lens.roll_rad, lens.quarter_turns)):
            return lens
        tilt = self.tilt or Tilt(0.0, 0.0)
        return replace(
            lens,
            height_m=self.height_m,
            pitch_rad=tilt.pitch_rad,
            roll_rad=tilt.roll_rad,
            quarter_turns=self.quarter_turns,
        )


def _upright(tilt: Tilt, quarter_turns: int) -> Tilt:
    return Tilt(tilt.pitch_rad, _wrapped(tilt.roll_rad + quarter_turns * np.pi / 2))


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)
