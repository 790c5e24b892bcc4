"""PyBullet's software renderer: slower than Embree, and used if Embree is missing."""

import numpy as np
import pybullet
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import SceneError
from ltvn_core.simulation.rendering.embree_renderer import MAX_DEPTH_M, VisibleScene
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Surfaces
from ltvn_core.types import Depth, Pose, Rgb

_NEAR_M = 0.02
_CORNERS_AT_ONCE = 30_000
"""Number of corners per mesh, a multiple of three; PyBullet rejects meshes with more than about 130,000 vertices."""
_FAR_M = 2 * MAX_DEPTH_M


class PyBulletRenderer:
    """Renders with TinyRenderer. Implements `ltvn_core.types.Renderer`."""

    name = "TinyRenderer"

    def __init__(self, surfaces: Surfaces) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        self._light = PLAIN_LIGHT
        self._add_all(surfaces)

    def show(self, scene: VisibleScene) -> None:
        """Render another state of the scene from now on, which takes as long as opening it."""
        pybullet.resetSimulation(physicsClientId=self._client)
        self._light = scene.light
        for surfaces in (scene.surfaces, *scene.added):
            self._add_all(surfaces)

    def _add_all(self, surfaces: Surfaces) -> None:
        for texture in np.unique(surfaces.face_texture):
            part = surfaces.only(surfaces.face_texture == texture)
            corners = part.vertices[part.faces].reshape(-1, 3)
            for first in range(0, len(corners), _CORNERS_AT_ONCE):
                self._add(corners[first : first + _CORNERS_AT_ONCE], surfaces.textures[texture])

    def close(self) -> None:
        """Free the renderer; closing twice is allowed."""
        if self._client >= 0:
            pybullet.disconnect(self._client)
        self._client = -1

    def render(self, pose: Pose, camera: CameraModel) -> tuple[Rgb, Depth]:
        """Return rgb (H, W, 3) and depth (H, W) in metres along the optical axis, 0 beyond 10 m.

        Raises:
            SceneError: The camera's lens distorts, or it is rolled or turned.
        """
        if not camera.is_ideal:
            raise SceneError(
                "PyBullet's TinyRenderer renders level or tilted cameras without distortion only; install embreex for "
                "any other camera."
            )
        eye = (pose[0], pose[1], camera.height_m)
        rise = camera.height_m + np.tan(camera.pitch_rad)
        ahead = (pose[0] + np.cos(pose[2]), pose[1] + np.sin(pose[2]), rise)
        view = pybullet.computeViewMatrix(eye, ahead, (0, 0, 1))
        lens = _projection(camera)
        size = camera.width, camera.height
        *_, rgba, buffer, _ = pybullet.getCameraImage(
            *size, view, lens, shadow=0, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self._client
        )
        shape = camera.height, camera.width
        rgb = np.asarray(rgba, np.uint8).reshape(*shape, 4)[..., :3].copy()
        # TinyRenderer returns OpenGL's depth buffer, which is not linear in depth.
        depth = _FAR_M * _NEAR_M / (_FAR_M - (_FAR_M - _NEAR_M) * np.asarray(buffer, np.float32).reshape(shape))
        return rgb, np.where(depth <= MAX_DEPTH_M, depth, 0).astype(np.float32)

    def _add(self, corners: NDArray[np.float32], texture: Rgb) -> None:
        """Add triangles with corners (3 N, 3), visible from both sides, in the mean colour of their texture."""
        order = np.arange(len(corners)).reshape(-1, 3)
        colour = np.minimum(texture.reshape(-1, 3).mean(0) / 255 * self._light, 1.0)
        both_sides = np.concatenate([order, order[:, ::-1]]).ravel()
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=corners.tolist(),
            indices=both_sides.tolist(),
            rgbaColor=(*colour, 1),
            physicsClientId=self._client,
        )
        pybullet.createMultiBody(baseVisualShapeIndex=shape, physicsClientId=self._client)


def _projection(camera: CameraModel) -> list[float]:
    """Return the projection matrix, shifted by half a pixel, because TinyRenderer samples at the corners of pixels."""
    across = _NEAR_M / camera.fx
    down = _NEAR_M / camera.fy
    left = -camera.cx * across
    right = (camera.width - camera.cx) * across
    bottom = (camera.cy + 1 - camera.height) * down
    top = (camera.cy + 1) * down
    edges = (left, right, bottom, top)
    return pybullet.computeProjectionMatrix(*edges, _NEAR_M, _FAR_M)
