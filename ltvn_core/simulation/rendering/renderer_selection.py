"""Which renderer works on this machine: Embree, else PyBullet's software renderer.

Owns the choice, and the check that the first image shows something.
"""

import logging
import time
from typing import Protocol

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import SceneError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.types import Pose, Renderer

log = logging.getLogger(__name__)

_TIMED_IMAGES = 10
"""Images that are rendered to measure the speed."""
_BLANK_SPREAD = 2.0
"""An image is blank if the standard deviation of its bytes is below this."""


class RenderableScene(Protocol):
    """What a renderer needs of a scene."""

    @property
    def name(self) -> str:
        """Name of the scene, for messages."""
        ...

    @property
    def surfaces(self) -> Surfaces:
        """What is rendered."""
        ...

    @property
    def clearance(self) -> ClearanceMap:
        """Where the camera can be."""
        ...


def open_renderer(scene: RenderableScene, camera: CameraModel = LOCOBOT.camera) -> Renderer:
    """Return the best renderer that is installed: Embree, else PyBullet's TinyRenderer.

    Logs which one it is and how fast it renders for `camera`.

    Raises:
        SceneError: The first image is blank, or no renderer is installed.
    """
    renderer = _installed_renderer(scene)
    pose = scene.clearance.sample_poses(np.random.default_rng(0), 1)[0]
    _check_first_image(renderer, camera, pose, scene.name)
    start = time.perf_counter()
    for _ in range(_TIMED_IMAGES):
        renderer.render(pose, camera)
    rate = _TIMED_IMAGES / (time.perf_counter() - start)
    log.info("Camera: %s, %.0f frames of %d x %d per second.", renderer.name, rate, camera.width, camera.height)
    return renderer


class _NamedRenderer(Renderer, Protocol):
    @property
    def name(self) -> str: ...


def _installed_renderer(scene: RenderableScene) -> _NamedRenderer:
    try:
        return EmbreeRenderer(scene.surfaces)
    except ImportError as missing:
        log.warning("Embree is missing (%s); PyBullet renders instead, more slowly.", missing)
    try:
        # Imported here, because PyBullet has no wheel for most platforms and Embree is enough.
        from ltvn_core.simulation.rendering.pybullet_renderer import PyBulletRenderer
    except ImportError as missing:
        raise SceneError(
            f"Scene {scene.name} cannot be rendered: neither embreex nor pybullet is installed ({missing}). Run "
            "`pip install embreex`."
        ) from missing
    return PyBulletRenderer(scene.surfaces)


def _check_first_image(renderer: _NamedRenderer, camera: CameraModel, pose: Pose, name: str) -> None:
    rgb, depth = renderer.render(pose, camera)
    if not depth.any() or rgb.std() < _BLANK_SPREAD:
        raise SceneError(
            f"The first image of scene {name} by {renderer.name} is blank. Check that the scene has surfaces around "
            f"x {pose[0]:.1f} m, y {pose[1]:.1f} m, or reinstall embreex."
        )
