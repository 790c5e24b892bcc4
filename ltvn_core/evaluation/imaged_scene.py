"""A scene with images at known poses, as driving single edges needs it. They come from a labelled drive or a map."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import FrameId, Pose, Renderer

if TYPE_CHECKING:
    from ltvn_core.simulation.scene import Scene


@dataclass(frozen=True, eq=False)
class ImagedScene:
    """A scene with encoded images at exact poses."""

    scene: "Scene"
    camera: Renderer
    keyframes: KeyframeStore
    """The images, encoded."""
    poses: Mapping[FrameId, Pose]
    """(3,) exact pose of each image."""

    def farthest_from(self, frame: FrameId) -> FrameId:
        """Return the image taken farthest from another."""
        away = np.array(list(self.poses.values()))[:, :2] - self.poses[frame][:2]
        return list(self.poses)[int(np.hypot(*away.T).argmax())]
