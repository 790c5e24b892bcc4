"""A scene with images at known poses, as driving single edges needs it. They come from a labelled drive or a map."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
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
    spec: RobotSpec = LOCOBOT
    """The robot that took the images."""

    def farthest_from(self, source: FrameId, *, other_than: FrameId) -> FrameId:
        """Return the image taken farthest from `source`, which is neither that one nor `other_than`."""
        here = self.poses[source]
        others = [frame for frame in self.poses if frame not in (source, other_than)]
        return max(others, key=lambda frame: float(np.hypot(*(self.poses[frame] - here)[:2])))
