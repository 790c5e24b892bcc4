"""Opens the renderer of a scene, and checks that its first image is not blank."""

import logging
import time
from typing import Protocol

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import SceneError
from ltvn_core.extras import missing_text
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Pose

log = logging.getLogger(__name__)

_TIMED_IMAGES = 10
"""Number of images rendered to measure the speed."""
_LOOKS = 12
"""Maximum number of places from which the scene is checked for visible surfaces."""
_SEEN_SHARE = 0.05
"""Least share of pixels with depth in a room; a smaller share means that the camera looks over the edge of a floor into
empty space."""
_BLANK_SPREAD = 2.0
"""An image is blank if the standard deviation of its bytes is below this."""


class RenderableScene(Protocol):
    """The interface of a scene that a renderer needs."""

    @property
    def name(self) -> str:
        """Name of the scene, for messages."""
        ...

    @property
    def surfaces(self) -> Surfaces:
        """Surfaces to render."""
        ...

    @property
    def clearance(self) -> ClearanceMap:
        """Clearance map, for poses of the camera."""
        ...


def open_renderer(scene: RenderableScene, camera: CameraModel = LOCOBOT.camera) -> EmbreeRenderer:
    """Return the renderer of a scene; logs how fast it renders for `camera`.

    Raises:
        SceneError: All images are blank, or Embree is not installed.
    """
    try:
        renderer = EmbreeRenderer(scene.surfaces)
    except ImportError as missing:
        raise SceneError(f"Scene {scene.name} cannot be rendered ({missing}). {missing_text('embreex')}") from missing
    pose = _pose_with_a_view(renderer, camera, scene)
    start = time.perf_counter()
    for _ in range(_TIMED_IMAGES):
        renderer.render(pose, camera)
    rate = _TIMED_IMAGES / (time.perf_counter() - start)
    log.info("Camera: %.0f frames of %d x %d per second.", rate, camera.width, camera.height)
    return renderer


def _pose_with_a_view(renderer: EmbreeRenderer, camera: CameraModel, scene: RenderableScene) -> Pose:
    """Return a pose (3,) whose image is not blank. One blank image does not prove a failure, because it may show a bare
    wall or the open, so several poses are tried.

    Raises SceneError if all images are blank.
    """
    poses = scene.clearance.sample_poses(np.random.default_rng(0), _LOOKS)
    for pose in poses:
        rgb, depth = renderer.render(pose, camera)
        if (depth > 0).mean() >= _SEEN_SHARE and rgb.std() >= _BLANK_SPREAD:
            return pose
    raise SceneError(
        f"The first image of scene {scene.name}, and those from {_LOOKS - 1} more places on its "
        "floor, are blank. Is it a mesh of rooms, the right way up? Set the axis that points up or the height of the "
        'floor in the JSON file beside a mesh, for instance {"up": "z", "floor_height": 0.0}; in a scene of ours, '
        "reinstall embreex."
    )
