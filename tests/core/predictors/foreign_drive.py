"""A short drive through a room with a camera that is not the simulator's, as `ltvn import` writes it."""

from pathlib import Path

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.types import Observation
from tests.core.predictors.textured_room import TexturedRoom

CAMERA = CameraModel.from_fov(160, 120, 1.1, height_m=0.45)


def foreign_images(count: int) -> list[Observation]:
    """Return images along a line through the room, as that camera takes them."""
    room = TexturedRoom(3)
    poses = np.column_stack(
        [0.7 + 0.14 * np.arange(count), np.full(count, 2.0), 0.1 * np.sin(np.linspace(0, 6, count))]
    )
    return [room.observe(pose, step, CAMERA) for step, pose in enumerate(poses)]


def write_foreign_drive(path: Path, images: int) -> Path:
    """Write these images as an imported drive."""
    config = {"verb": "import"}
    with RecordingWriter(path, scene="a real house", config=config, fingerprint="", camera=CAMERA) as writer:
        for seen in foreign_images(images):
            writer.write_frame(seen)
    return path
