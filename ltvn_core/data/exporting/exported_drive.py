"""A drive for export: the frames of a recording with their data, still compressed.

Owns the choice of frames and the camera's pose in space, in the conventions of other programs. Images are copied from
the recording unchanged, because every compression loses some quality.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.source_camera import CAMERA_FILE
from ltvn_core.data.importing.spatial_pose import BODY_FROM_OPTICAL
from ltvn_core.data.recording.frame_codec import decode_depth
from ltvn_core.data.recording.metadata import is_lens_known
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import RecordingError
from ltvn_core.types import Depth, Pose, Tilt

MILLIMETRES_PER_METRE = 1000


class CameraPlace(NamedTuple):
    """Where the camera's optical frame was, in a frame whose z is up."""

    position: NDArray[np.float64]
    """(3,) metres."""
    rotation: Rotation
    """Rotation from the optical frame (right, down, forward) to that frame."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExportedFrame:
    """One frame of a drive."""

    stamp: float
    """Time on the robot's clock in seconds, starting at 0."""
    jpeg: bytes
    """Colour image as JPEG."""
    depth_png: bytes | None
    """Depth in whole millimetres; None without a depth camera."""
    odometry: Pose
    """Pose (3,) by odometry."""
    truth: Pose | None
    """True pose (3,) from simulation or an import; None if it is unknown."""
    tilt: Tilt
    """Tilt of the camera at that moment."""

    @property
    def depth_m(self) -> Depth | None:
        """Depth (H, W) in metres."""
        return None if self.depth_png is None else decode_depth(self.depth_png)

    @property
    def depth_millimetres(self) -> NDArray[np.uint16] | None:
        """Depth (H, W) in whole millimetres."""
        return None if self.depth_m is None else np.rint(self.depth_m * MILLIMETRES_PER_METRE).astype(np.uint16)


class ExportedDrive:
    """The frames of a recording between two moments."""

    def __init__(self, recording: Recording, *, from_s: float | None = None, to_s: float | None = None) -> None:
        """Choose the frames. Raises RecordingError if there are none."""
        self._recording = recording
        self.camera: CameraModel = recording.meta.camera
        self.name = recording.path.stem
        stamps = recording.poses.stamps
        inside = (stamps >= (-np.inf if from_s is None else from_s)) & (stamps <= (np.inf if to_s is None else to_s))
        self._steps = [int(step) for step in recording.poses.steps[inside]]
        if not self._steps:
            raise RecordingError(
                f"{recording.path} has {len(recording.frames)} frames, and none of them between these moments."
            )
        self._offset = min(0.0, float(stamps[inside].min()))

    def write_camera(self, folder: Path, *, units_per_metre: float | None = None) -> None:
        """Write the `camera.json` of a folder, with the units per metre of its depth images. Raises OSError.

        The focal lengths of an assumed lens are null, so that it is not mistaken for a calibrated one.
        """
        camera = {**self.camera.to_json(), "depth_scale": units_per_metre}
        if not is_lens_known(self._recording.meta):
            camera |= {"fx": None, "fy": None}
        (folder / CAMERA_FILE).write_text(json.dumps(camera, indent=2), encoding="utf-8")

    def __len__(self) -> int:
        """Count the frames."""
        return len(self._steps)

    @cached_property
    def has_depth(self) -> bool:
        """Whether every frame has a depth image."""
        return all(self._recording.stored_frame(step).frame.depth is not None for step in self._steps)

    @cached_property
    def rate_hz(self) -> float:
        """Median frame rate, in frames per second."""
        poses = self._recording.poses
        gaps = np.diff(poses.stamps[np.isin(poses.steps, self._steps)])
        return float(1 / np.median(gaps)) if len(gaps) and np.median(gaps) > 0 else 1.0

    @cached_property
    def turns_camera(self) -> bool:
        """Whether any frame has a tilt of its own that differs from the camera's mounting."""
        return any(self._recording.stored_frame(step).frame.tilt is not None for step in self._steps)

    def frames(self) -> Iterator[ExportedFrame]:
        """Yield the frames in order."""
        usual = Tilt(self.camera.pitch_rad, self.camera.roll_rad)
        for step in self._steps:
            frame = self._recording.stored_frame(step).frame
            yield ExportedFrame(
                stamp=frame.stamp - self._offset,
                jpeg=frame.rgb,
                depth_png=frame.depth,
                odometry=frame.odometry,
                truth=frame.exact_pose,
                tilt=frame.tilt or usual,
            )

    def on_robot(self, tilt: Tilt) -> CameraPlace:
        """Return the camera's place in the robot's frame, whose origin is on the floor below the camera."""
        body = Rotation.from_euler("ZYX", [0.0, -tilt.pitch_rad, tilt.roll_rad])
        quarter = Rotation.from_euler("x", -self.camera.quarter_turns * np.pi / 2)
        turn = body * quarter * Rotation.from_matrix(BODY_FROM_OPTICAL)
        return CameraPlace(np.array([0.0, 0.0, self.camera.height_m]), turn)

    def in_world(self, pose: Pose, tilt: Tilt) -> CameraPlace:
        """Return the camera's place in the frame in which a robot's pose (3,) is given."""
        x, y, yaw = pose
        position, turn = self.on_robot(tilt)
        return CameraPlace(np.array([x, y, position[2]]), Rotation.from_euler("z", yaw) * turn)
