"""What it costs to build a map."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.measurement import Measurement, measured, seconds, seconds_once
from benchmarks.recording import demo_observations
from ltvn_core.config import ROBUST
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.network.predictor import NetworkPredictor, load_predictor
from ltvn_core.types import Features, Observation, Prediction, Predictor

NODES = 1_000
TRAJECTORY = 2_243
"""Images in the longest trajectory of the paper."""


class _CountingPredictor:
    """A predictor that counts its work. Implements `ltvn_core.types.Predictor`."""

    def __init__(self, inner: NetworkPredictor) -> None:
        self._inner = inner
        self.fingerprint = inner.fingerprint
        self.camera = inner.camera
        self.may_match = inner.may_match
        self.encoded = 0
        self.compared = 0

    def encode(self, observations: Sequence[Observation]) -> Features:
        self.encoded += len(observations)
        return self._inner.encode(observations)

    def predict(self, sources: Features, targets: Features) -> Prediction:
        self.compared += max(len(sources), len(targets))
        return self._inner.predict(sources, targets)


def build_map() -> list[Measurement]:
    """Build a map from 2,243 images."""
    predictor = load_predictor()
    observations = demo_observations(TRAJECTORY)
    counting = _CountingPredictor(predictor)
    spent_s = _build_s(observations, counting)
    nodes = predictor.encode(observations[:NODES])
    pair_s = seconds(lambda: predictor.predict(nodes, np.roll(nodes, 1, axis=0)), 3) / NODES
    every_pair_s = pair_s * math.perm(len(observations), 2)
    return [
        measured("build: times each image is encoded", counting.encoded / len(observations), "", at_most=1),
        measured("build from 2,243 images against all pairs", every_pair_s / spent_s, "x faster", at_least=20),
    ]


def build_s(images: int) -> float:
    """Return the time in seconds to build a map from a number of images."""
    return _build_s(demo_observations(images), load_predictor())


def _build_s(observations: Sequence[Observation], predictor: Predictor) -> float:
    return seconds_once(
        lambda: build(observations, KeyframeStore(predictor), predictor, ROBUST, np.random.default_rng(0))
    )
