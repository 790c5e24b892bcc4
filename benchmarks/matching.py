"""What it costs to compare one image with a map, and to build one."""

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.measurement import Measurement, alternating, measured, seconds, seconds_once
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


def localise_and_build() -> list[Measurement]:
    """Compare one image with 1,000 nodes, and build a map from 2,243 images."""
    predictor = load_predictor()
    observations = demo_observations(TRAJECTORY)
    return [*_localise(predictor, observations[:NODES]), *_build(predictor, observations)]


def _localise(predictor: Predictor, observations: list[Observation]) -> list[Measurement]:
    """Against a stacked-pair network with the same encoder, which must look at each pair from the pixels on."""
    nodes = predictor.encode(observations)

    def localise() -> None:
        predictor.predict(predictor.encode(observations[:1]), nodes)

    ratio = alternating(localise, lambda: predictor.encode(observations), 3)
    return [measured("localise in 1,000 nodes against stacked pairs", ratio, "x faster", at_least=100)]


def _build(predictor: NetworkPredictor, observations: list[Observation]) -> list[Measurement]:
    counting = _CountingPredictor(predictor)
    build_s = seconds_once(
        lambda: build(observations, KeyframeStore(counting), counting, ROBUST, np.random.default_rng(0))
    )
    nodes = predictor.encode(observations[:NODES])
    pair_s = seconds(lambda: predictor.predict(nodes, np.roll(nodes, 1, axis=0)), 3) / NODES
    every_pair_s = pair_s * math.perm(len(observations), 2)
    return [
        measured("build: times each image is encoded", counting.encoded / len(observations), "", at_most=1),
        measured("build from 2,243 images against all pairs", every_pair_s / build_s, "x faster", at_least=20),
    ]
