"""How a camera is mounted on a robot: its height, its tilt, and whether it lies on its side.

Owns the split of a turn about the optical axis into quarter turns and a small roll, and the question whether an image
was tilted in another way than by the mounting.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.importing.moving_frame import Transform
from ltvn_core.importing.spatial_pose import BODY_FROM_OPTICAL, spatial_pose
from ltvn_core.types import Tilt

LOWEST_M = 0.02
"""A camera lower than this stands at the origin of its frames, and nobody said how high that is."""
_SAME_TILT_RAD = np.radians(0.5)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraMounting:
    """Where a camera is on its robot."""

    camera_on_robot: Transform
    """(4, 4): the optical frame in the robot's frame; at its origin, straight ahead, where it is unknown."""
    tilt: Tilt | None = None
    """On a level robot, of an image that was turned upright; None where it is unknown."""
    quarter_turns: int = 0
    """How often images must be turned to stand upright, see `CameraModel`."""
    height_m: float = 0.0
    """Above the ground; 0 where it is unknown."""

    @classmethod
    def unknown(cls) -> Self:
        """Return the mounting of a camera of which nothing is said."""
        camera_on_robot = np.eye(4)
        camera_on_robot[:3, :3] = BODY_FROM_OPTICAL
        return cls(camera_on_robot=camera_on_robot)

    @classmethod
    def of(cls, camera_on_robot: Transform) -> Self:
        """Return the mounting of a camera whose optical frame (4, 4) is known in the robot's."""
        seen = spatial_pose(camera_on_robot[:3, 3], camera_on_robot[:3, :3])
        turns = round(-seen.tilt.roll_rad / (np.pi / 2)) % 4
        return cls(
            camera_on_robot=camera_on_robot,
            tilt=_upright(seen.tilt, turns),
            quarter_turns=turns,
            height_m=seen.height_m if seen.height_m > LOWEST_M else 0.0,
        )

    def own_tilt(self, tilt: Tilt) -> Tilt | None:
        """Return the tilt of an image that was turned upright, None where it is the one of the mounting."""
        upright = _upright(tilt, self.quarter_turns)
        usual = self.tilt or Tilt(0.0, 0.0)
        apart = max(abs(upright.pitch_rad - usual.pitch_rad), abs(_wrapped(upright.roll_rad - usual.roll_rad)))
        return None if apart < _SAME_TILT_RAD else upright

    def mounted(self, lens: CameraModel) -> CameraModel:
        """Return a lens as it is mounted; one that says itself how it is mounted stays as it is."""
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
