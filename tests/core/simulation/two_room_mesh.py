"""A house of two rooms in the formats that other people use: floor, ceiling, walls, and a doorway in between.

The inner floor spans 6 x 4 m; the wall with the doorway stands at x = 3. The west room's outer wall is red, the east
room's is blue, all else is grey.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual.color import ColorVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial
from trimesh.visual.texture import TextureVisuals

RED, BLUE, GREY = (200, 40, 40), (40, 60, 200), (150, 150, 150)
HEIGHT = 2.5
Paint = str
"""`texture`, `vertex` or `material`."""

Box = tuple[tuple[float, float, float], tuple[float, float, float], tuple[int, int, int]]
BOXES: tuple[Box, ...] = (
    ((-0.1, -0.1, -0.1), (6.1, 4.1, 0.0), GREY),
    ((-0.1, -0.1, HEIGHT), (6.1, 4.1, HEIGHT + 0.1), GREY),
    ((-0.1, 0.0, 0.0), (0.0, 4.0, HEIGHT), RED),
    ((6.0, 0.0, 0.0), (6.1, 4.0, HEIGHT), BLUE),
    ((-0.1, -0.1, 0.0), (6.1, 0.0, HEIGHT), GREY),
    ((-0.1, 4.0, 0.0), (6.1, 4.1, HEIGHT), GREY),
    ((2.95, 0.0, 0.0), (3.05, 1.5, HEIGHT), GREY),
    ((2.95, 2.5, 0.0), (3.05, 4.0, HEIGHT), GREY),
)


def box_house(paint: Paint = "texture", *, up: str = "z", ground: float = 0.0, scale: float = 1.0) -> trimesh.Scene:
    """Build the house; its floor lies at `ground` metres, then all is multiplied by `scale`."""
    scene = trimesh.Scene()
    for low, high, colour in BOXES:
        part = trimesh.creation.box(bounds=[low, high])
        part.unmerge_vertices()
        _paint(part, colour, paint)
        part.apply_translation((0, 0, ground))
        part.apply_scale(scale)
        if up == "y":
            part.vertices = part.vertices[:, [0, 2, 1]] * (1, 1, -1)
        scene.add_geometry(part)
    return scene


def save(house: trimesh.Scene, path: Path) -> Path:
    """Write the house in the format of the path's ending."""
    path.parent.mkdir(parents=True, exist_ok=True)
    (house if path.suffix in (".glb", ".gltf", ".obj") else house.to_mesh()).export(path)
    return path


def _paint(part: trimesh.Trimesh, colour: tuple[int, int, int], paint: Paint) -> None:
    if paint == "vertex":
        part.visual = ColorVisuals(
            part, vertex_colors=np.tile((*colour, 255), (len(part.vertices), 1)).astype(np.uint8)
        )
        return
    uv = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), (len(part.faces), 1))
    if paint == "texture":
        material = PBRMaterial(baseColorTexture=Image.new("RGB", (30, 20), colour))
    else:
        material = SimpleMaterial(diffuse=(*colour, 255))
    part.visual = TextureVisuals(uv=uv, material=material)
