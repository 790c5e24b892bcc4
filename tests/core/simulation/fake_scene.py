"""A small room that needs no generator, and a camera that needs no renderer."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Depth, Pose, Rgb

BOX_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True)
class Box:
    """An upright obstacle, all in metres."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]


WALLS = (
    Box((0.0, 0.0, 0.0), (6.0, 0.1, 2.5)),
    Box((0.0, 4.9, 0.0), (6.0, 5.0, 2.5)),
    Box((0.0, 0.0, 0.0), (0.1, 5.0, 2.5)),
    Box((5.9, 0.0, 0.0), (6.0, 5.0, 2.5)),
)
FURNITURE = (
    Box((2.8, 0.0, 0.0), (2.9, 1.6, 2.5)),
    Box((2.8, 3.0, 0.0), (2.9, 5.0, 2.5)),
    Box((4.2, 3.4, 0.0), (5.0, 4.0, 0.4)),
    Box((0.9, 1.2, 0.70), (1.5, 1.6, 0.74)),  # A table top without legs.
)


@dataclass(frozen=True)
class BoxScene:
    """Two rooms with a wide opening between them."""

    boxes: tuple[Box, ...] = WALLS + FURNITURE

    def collision_triangles(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        corners = [np.array(box.low) + BOX_CORNERS * (np.array(box.high) - box.low) for box in self.boxes]
        faces = [BOX_FACES + 8 * number for number in range(len(self.boxes))]
        return np.concatenate(corners), np.concatenate(faces)

    @cached_property
    def clearance(self) -> ClearanceMap:
        x, y = np.meshgrid(np.arange(0.025, 6, 0.05), np.arange(0.025, 5, 0.05))
        blocked = np.zeros(x.shape, bool)
        for box in self.boxes:
            blocked |= (x > box.low[0]) & (x < box.high[0]) & (y > box.low[1]) & (y < box.high[1])
        return ClearanceMap(blocked, np.zeros(2))


class GreyCamera:
    """Sees grey at one metre, and counts how often it looked."""

    def __init__(self) -> None:
        self.renders = 0

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        self.renders += 1
        shape = (camera.height, camera.width)
        return np.full((*shape, 3), 127, np.uint8), np.ones(shape, np.float32)
