"""A picture without depth finds the nodes that look like it."""

from dataclasses import replace

import numpy as np

from ltvn_core.analysis.image_similarity import most_similar_nodes
from ltvn_core.graph.keyframes import KeyframeStore
from tests.core.flat_world import FlatPredictor, observation_at, one_room

RNG = np.random.default_rng(0)


def noise_images(count: int) -> KeyframeStore:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    for k in range(count):
        patches = RNG.integers(0, 256, (9, 12, 3), dtype=np.uint8)
        rgb = patches.repeat(8, axis=0).repeat(8, axis=1)
        keyframes.add([replace(observation_at(np.zeros(3), k), rgb=rgb)])
    return keyframes


def test_the_same_image_comes_first_even_noisy_and_darker() -> None:
    keyframes = noise_images(20)
    seen = keyframes.observation(13).rgb.astype(np.float64) * 0.6 + RNG.normal(0, 10, (72, 96, 3))
    ranked = most_similar_nodes(seen.clip(0, 255).astype(np.uint8), keyframes, range(20), 3)
    assert ranked[0][0] == 13
    assert ranked[0][1] > 0.9 > ranked[1][1]
    assert len(ranked) == 3


def test_a_blank_image_looks_like_nothing_in_particular() -> None:
    ranked = most_similar_nodes(np.full((72, 96, 3), 90, np.uint8), noise_images(4), range(4), 2)
    assert [likeness for _, likeness in ranked] == [0.0, 0.0]


def test_without_nodes_nothing_looks_alike() -> None:
    assert most_similar_nodes(np.zeros((72, 96, 3), np.uint8), noise_images(1), [], 3) == ()
