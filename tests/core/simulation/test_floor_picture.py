"""The picture of a scene from straight above: what lies where, and which way is up."""

import numpy as np
import pytest

pytest.importorskip("embreex")

from ltvn_core.simulation.rendering.floor_picture import floor_picture
from ltvn_core.simulation.surfaces import Surfaces

RED = np.array([200, 20, 20], np.uint8)
BLUE = np.array([20, 20, 200], np.uint8)


def tile(x: float, y: float, z: float = 0.0) -> list[list[float]]:
    """The corners of a square metre."""
    return [[x, y, z], [x + 1, y, z], [x + 1, y + 1, z], [x, y + 1, z]]


def scene(*tiles: tuple[list[list[float]], int]) -> Surfaces:
    """Square metres of one colour each, 0 red and 1 blue."""
    vertices = np.concatenate([corners for corners, _ in tiles]).astype(np.float32)
    faces = [[4 * k + i for i in triangle] for k in range(len(tiles)) for triangle in ((0, 1, 2), (0, 2, 3))]
    return Surfaces(
        vertices=vertices,
        faces=np.array(faces, np.int32),
        corner_uv=np.zeros((len(faces), 3, 2), np.float32),
        face_texture=np.repeat([colour for _, colour in tiles], 2).astype(np.int32),
        overhead=np.zeros(len(faces), bool),
        textures=tuple(np.tile(colour, (2, 2, 1)) for colour in (RED, BLUE)),
    )


def is_red(colour: np.ndarray) -> bool:
    return bool(colour[0] > colour[2])


def test_x_is_right_and_y_is_up_and_every_metre_is_as_large() -> None:
    found = floor_picture(scene((tile(0, 0), 0), (tile(1, 0), 1), (tile(0, 1), 1)), (0, 0), (2, 2), most_px=20)
    assert found.shape == (20, 20, 3)
    assert is_red(found[15, 5])
    assert not is_red(found[15, 15])
    assert not is_red(found[5, 5])


def test_the_higher_hides_the_lower_and_nothing_is_where_nothing_is() -> None:
    found = floor_picture(scene((tile(0, 0), 0), (tile(0, 0, 0.5), 1), (tile(2, 0), 0)), (0, 0), (3, 1), most_px=300)
    assert found.shape == (100, 300, 3)
    assert not is_red(found[50, 50])
    assert is_red(found[50, 250])
    assert (found[50, 150] == found[50, 151]).all()
    assert not is_red(found[50, 150])
