"""How fast the camera is on a large mesh, against casting its rays alone."""

from itertools import cycle

import numpy as np

from benchmarks.measurement import Measurement, alternating, measured
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.rendering.ray_casting import RayCaster
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.surfaces import Surfaces

TRIANGLES = 146_000
"""As many as the scan of a furnished house has."""
LENS = LOCOBOT.camera


def render_large_mesh() -> list[Measurement]:
    """Look at the demo apartment, cut up into as many triangles as a scan, and cast the same rays."""
    scene = load_scene("demo")
    surfaces = scene.surfaces
    while len(surfaces.faces) < TRIANGLES:
        surfaces = quartered(surfaces)
    poses = cycle(scene.clearance.sample_poses(np.random.default_rng(0), 50))
    plain = EmbreeRenderer(surfaces, supersampling=1)
    caster = RayCaster(surfaces.vertices, surfaces.faces)
    rays = alternating(lambda: caster.cast(*_rays(next(poses))), lambda: plain.render(next(poses), LENS), 50)
    return [measured("shading and casting against casting alone", rays, "x", at_most=2)]


def quartered(surfaces: Surfaces) -> Surfaces:
    """Cut every triangle into four that look the same."""
    corners, uv = surfaces.vertices[surfaces.faces], surfaces.corner_uv
    pieces = [_four(corners), _four(uv)]
    count = len(pieces[0])
    return Surfaces(
        pieces[0].reshape(-1, 3),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        pieces[1],
        np.tile(surfaces.face_texture, 4),
        np.tile(surfaces.overhead, 4),
        surfaces.textures,
    )


def _four(corners: np.ndarray) -> np.ndarray:
    """Split (F, 3, D) at the middles of its sides into (4 F, 3, D)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(part, 1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _rays(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and directions (N, 3) of a picture's rays."""
    across = np.linspace(-1, 1, LENS.width) * np.tan(LENS.horizontal_fov_rad / 2)
    left, up = (part.ravel() for part in np.meshgrid(across, across[: LENS.height] - across[LENS.height // 2]))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    directions = np.column_stack([cos - sin * left, sin + cos * left, up]).astype(np.float32)
    return np.tile(np.array([*pose[:2], LENS.height_m], np.float32), (len(directions), 1)), directions
