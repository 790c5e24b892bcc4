"""A picture without depth finds the nodes that look like it."""

from dataclasses import replace

import numpy as np

from ltvn_core.graph.lookalike import nearest_pictures
from ltvn_core.graph.views import Views
from tests.core.world import FlatPredictor, look_at, one_room

RNG = np.random.default_rng(0)


def pictures(count: int) -> Views:
    views = Views(FlatPredictor(one_room()))
    for k in range(count):
        patches = RNG.integers(0, 256, (9, 12, 3), dtype=np.uint8)
        rgb = patches.repeat(8, axis=0).repeat(8, axis=1)
        views.add([replace(look_at(np.zeros(3), k), rgb=rgb)])
    return views


def test_the_same_picture_comes_first_even_noisy_and_darker() -> None:
    views = pictures(20)
    seen = views.observation(13).rgb.astype(np.float64) * 0.6 + RNG.normal(0, 10, (72, 96, 3))
    ranked = nearest_pictures(seen.clip(0, 255).astype(np.uint8), views, range(20), 3)
    assert ranked[0][0] == 13
    assert ranked[0][1] > 0.9 > ranked[1][1]
    assert len(ranked) == 3


def test_a_blank_picture_looks_like_nothing_in_particular() -> None:
    ranked = nearest_pictures(np.full((72, 96, 3), 90, np.uint8), pictures(4), range(4), 2)
    assert [likeness for _, likeness in ranked] == [0.0, 0.0]


def test_without_nodes_nothing_looks_alike() -> None:
    assert nearest_pictures(np.zeros((72, 96, 3), np.uint8), pictures(1), [], 3) == ()
