"""A predictor in two stages: place recognition proposes pairs of images, and a pose estimator verifies them.

Some models recognise a place but cannot estimate a pose; others estimate poses but are slow, or confuse similar walls.
Owns the combination of the two. Implements `ltvn_core.types.Predictor`.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.predictors.request import predictor_card
from ltvn_core.types import Features, Observation, Prediction, Predictor

PROPOSED = 32
"""Largest number of targets that the poser compares with one image; if more are proposed, the most similar ones are
kept."""
PROPOSED_R = 0.03
"""Least probability of showing the same place at which a pair is proposed. It is low, because the poser rejects false
proposals, but cannot find pairs that were not proposed."""
_UNRELATED = 0.01
"""Reachability of a pair that was not proposed; not 0, because Eq. 3 could never revise that."""


class Recogniser(Protocol):
    """Place recognition: decides whether two images show one place. Needs no depth and accepts any camera."""

    @property
    def fingerprint(self) -> str:
        """Identifier that changes whenever the same images give other results."""
        ...

    def describe(self, observations: Sequence[Observation]) -> NDArray[np.float32]:
        """Return a place descriptor for each image, (N, D)."""
        ...

    def same_place(self, sources: NDArray[np.float32], targets: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the probability (N,) that sources (N, D) or (1, D) show the places of targets (N, D)."""
        ...


class ComposedPredictor:
    """Runs the poser only on pairs proposed by the recogniser.

    Features are objects (N, 2): a place descriptor and a feature row of the poser.
    """

    def __init__(self, recogniser: Recogniser, poser: Predictor) -> None:
        """Combine the two; images must be those of the camera of `poser`, which gives the pose of a target, and r for
        its confidence."""
        self._recogniser = recogniser
        self._poser = poser
        self.needs_depth = predictor_card(poser).needs_depth

    @property
    def fingerprint(self) -> str:
        """Fingerprint of both parts."""
        return f"{self._recogniser.fingerprint}+{self._poser.fingerprint}"

    @property
    def camera(self) -> CameraModel:
        """Camera of the poser."""
        return self._poser.camera

    @property
    def likelihoods(self) -> Likelihoods | None:
        """Constants of the poser, because it makes the final decision."""
        return predictor_card(self._poser).likelihoods

    @property
    def merge_distance(self) -> float | None:
        """D_m of the poser, because it makes the final decision."""
        return predictor_card(self._poser).merge_distance

    @property
    def least_width_px(self) -> int:
        """Image width in pixels below which the poser recognises too little."""
        return predictor_card(self._poser).least_width_px

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, 2) features. Raises the errors of recogniser and poser."""
        rows = np.empty((len(observations), 2), object)
        described = self._recogniser.describe(observations)
        encoded = self._poser.encode(observations)
        for k in range(len(observations)):
            rows[k, 0], rows[k, 1] = described[k], encoded[k]
        return rows

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, 2) or (1, 2) with targets (N, 2).

        Pairs that are not proposed get a reachability of 0.01 and a waypoint of zeros that has no meaning.
        """
        reachability = np.full(len(targets), _UNRELATED)
        waypoints = np.zeros((len(targets), 3))
        chosen = self._proposals(sources, targets)
        if len(chosen):
            asked = sources if len(sources) == 1 else sources[chosen]
            reachability[chosen], waypoints[chosen] = self._poser.predict(
                np.stack([*asked[:, 1]]), np.stack([*targets[chosen, 1]])
            )
        return Prediction(reachability, waypoints)

    def _proposals(self, sources: Features, targets: Features) -> NDArray[np.intp]:
        """Return the rows of the targets that are proposed to the poser, in order."""
        if not len(targets):
            return np.empty(0, np.intp)
        likely = self._recogniser.same_place(np.stack([*sources[:, 0]]), np.stack([*targets[:, 0]]))
        chosen = np.flatnonzero(likely >= PROPOSED_R)
        if len(sources) == 1 and len(chosen) > PROPOSED:
            chosen = np.sort(chosen[np.argsort(-likely[chosen], kind="stable")[:PROPOSED]])
        return chosen
