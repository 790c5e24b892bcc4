"""Nothing that a camera can see makes the network fail or answer with anything but numbers."""

import itertools

import numpy as np

from ltvn_core.network.predictor import load_predictor
from ltvn_core.types import Observation

SIZE = (72, 96)


def strange_images() -> list[Observation]:
    """Every combination of strange colours and strange depth."""
    rng = np.random.default_rng(0)
    lone = np.zeros(SIZE, np.float32)
    lone[40, 50] = 1.0
    colours = [np.zeros((*SIZE, 3)), np.full((*SIZE, 3), 255), rng.integers(0, 256, (*SIZE, 3))]
    depths = [np.zeros(SIZE), np.full(SIZE, 0.001), np.full(SIZE, 65.535), lone, rng.random(SIZE) * 1e30]
    pairs = itertools.product(colours, depths)
    return [
        Observation(rgb.astype(np.uint8), depth.astype(np.float32), np.zeros(3), 0.0, step)
        for step, (rgb, depth) in enumerate(pairs)
    ]


def test_any_two_images_are_compared_with_finite_numbers() -> None:
    predictor = load_predictor()
    features = predictor.encode(strange_images())
    assert np.isfinite(features).all()
    for row in range(len(features)):
        found = predictor.predict(features[row : row + 1], features)
        assert np.isfinite(found.waypoints).all()
        assert ((found.reachability >= 0) & (found.reachability <= 1)).all()
