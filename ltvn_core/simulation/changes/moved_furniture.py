"""A scene's own furniture in another place."""

import numpy as np

from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.scene_parts import FurniturePiece
from ltvn_core.simulation.surface_builder import rounded_cos_sin
from ltvn_core.simulation.surfaces import Surfaces
from ltvn_core.worlds.world_change import PlaceRow


def moved_piece(surfaces: Surfaces, piece: FurniturePiece, pose: PlaceRow) -> Surfaces:
    """Return the surfaces of a piece as it looks at a pose, with its own textures alone."""
    faces = slice(piece.first_face, piece.end_face)
    corners = surfaces.vertices[surfaces.faces[faces]].reshape(-1, 3).astype(np.float64)
    used, texture = np.unique(surfaces.face_texture[faces], return_inverse=True)
    x, y, yaw = pose
    back, turn = _turn(piece.turn[0], -piece.turn[1]), _turn(*rounded_cos_sin(yaw))
    corners[:, :2] = (corners[:, :2] - (piece.x, piece.y)) @ back.T @ turn.T + (x, y)
    return Surfaces(
        vertices=corners.astype(np.float32),
        faces=np.arange(len(corners), dtype=np.int32).reshape(-1, 3),
        corner_uv=surfaces.corner_uv[faces],
        face_texture=texture.astype(np.int32),
        overhead=surfaces.overhead[faces],
        textures=tuple(surfaces.textures[number] for number in used),
    )


def piece_cells(piece: FurniturePiece, clearance: ClearanceMap) -> tuple[slice, slice]:
    """Return the rows and columns of the rectangle that a piece had to itself where it stood at first."""
    upright = abs(piece.turn[0]) > 0.5
    across, along = (piece.width, piece.depth) if upright else (piece.depth, piece.width)
    low = (np.array([piece.x - across / 2, piece.y - along / 2]) - clearance.origin) / clearance.resolution_m
    high = (np.array([piece.x + across / 2, piece.y + along / 2]) - clearance.origin) / clearance.resolution_m
    columns, rows = zip(np.rint(low).astype(int).tolist(), np.rint(high).astype(int).tolist(), strict=True)
    return slice(*rows), slice(*columns)


def _turn(cos: float, sin: float) -> np.ndarray:
    return np.array([[cos, -sin], [sin, cos]])
