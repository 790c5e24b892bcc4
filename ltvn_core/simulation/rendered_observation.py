"""Observations of a simulated camera whose colours are rendered when somebody asks for them.

Most images only tell a robot how far away things are, and colours cost most of a rendered image.
"""

from collections.abc import Callable
from typing import Protocol, Self, runtime_checkable

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.types import Depth, FrameId, Observation, Pose, Rgb

_NO_COLOURS = np.empty((0, 0, 3), np.uint8)


@runtime_checkable
class DepthFirstRenderer(Protocol):
    """A renderer that can leave the colours for later."""

    def measure(self, pose: Pose, camera: CameraModel) -> tuple[Callable[[], Rgb], Depth]:
        """Return the depth (H, W), and what renders the rgb (H, W, 3) of the scene as it is now."""
        ...


class RenderedObservation(Observation):
    """An observation like any other; `rgb` is rendered at its first use, as the world was when it was taken."""

    __slots__ = ("_render",)
    _render: Callable[[], Rgb] | None

    @classmethod
    def take(
        cls,
        render: Callable[[], Rgb],
        depth: Depth,
        *,
        odometry: Pose,
        stamp: float,
        step: FrameId,
        exact_pose: Pose,
    ) -> Self:
        """Take an observation with the colours that `render` will return."""
        taken = cls(_NO_COLOURS, depth, odometry, stamp, step, exact_pose)
        object.__setattr__(taken, "_render", render)
        object.__delattr__(taken, "rgb")  # So that who asks for it comes to `__getattr__`.
        return taken

    def __getattr__(self, name: str) -> Rgb:
        if name != "rgb":
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        render = self._render
        if render is not None:  # Another thread may have rendered it meanwhile.
            object.__setattr__(self, "rgb", render())
            object.__setattr__(self, "_render", None)  # It holds what the camera's rays met.
        return object.__getattribute__(self, "rgb")
