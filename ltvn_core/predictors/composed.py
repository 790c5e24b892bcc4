"""A predictor made of two: a recogniser proposes which images show one place, a poser confirms it and says where.

Some models know a place again and cannot say where in it they stand; others measure poses and are slow, or take one
wall for another. Owns how the two are put together. Implements `ltvn_core.types.Predictor`.
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
"""One image against more targets than this is compared by the poser with the most similar ones alone."""
PROPOSED_R = 0.03
"""What the recogniser thinks less likely than this is not proposed. Low, for what is left out here nobody finds again,
and what is let in by mistake the poser refuses."""
_UNRELATED = 0.01
"""Reachability of a pair that was not proposed. Not 0, because no evidence could revise such a belief."""


class Recogniser(Protocol):
    """Tells whether two images show one place. It needs no depth, and the images of any camera will do."""

    @property
    def fingerprint(self) -> str:
        """Changes whenever the same images give other numbers."""
        ...

    def describe(self, observations: Sequence[Observation]) -> NDArray[np.float32]:
        """Return a place descriptor for each image, (N, D)."""
        ...

    def same_place(self, sources: NDArray[np.float32], targets: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the probability (N,) that sources (N, D) or (1, D) show the places of targets (N, D)."""
        ...


class Poser(Predictor, Protocol):
    """Says where a target lies, and by r whether it could find that out: any predictor will do."""


class ComposedPredictor:
    """Asks the poser only what the recogniser proposes; its features are objects (N, 2): a descriptor and a row."""

    def __init__(self, recogniser: Recogniser, poser: Poser) -> None:
        """Put the two together; images are those of the poser's camera."""
        self._recogniser = recogniser
        self._poser = poser
        self.needs_depth = predictor_card(poser).needs_depth

    @property
    def fingerprint(self) -> str:
        """Name both."""
        return f"{self._recogniser.fingerprint}+{self._poser.fingerprint}"

    @property
    def camera(self) -> CameraModel:
        """The poser's."""
        return self._poser.camera

    @property
    def likelihoods(self) -> Likelihoods | None:
        """The poser's, for its word is the last."""
        return predictor_card(self._poser).likelihoods

    @property
    def merge_distance(self) -> float | None:
        """D_m of the poser, which decides in the end."""
        return predictor_card(self._poser).merge_distance

    @property
    def least_width_px(self) -> int:
        """Width below which the poser finds too little in an image."""
        return predictor_card(self._poser).least_width_px

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return (N, 2) features. Raises what recogniser and poser raise."""
        rows = np.empty((len(observations), 2), object)
        described = self._recogniser.describe(observations)
        encoded = self._poser.encode(observations)
        for k in range(len(observations)):
            rows[k, 0], rows[k, 1] = described[k], encoded[k]
        return rows

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare sources (N, 2) or (1, 2) with targets (N, 2).

        What is not proposed gets a reachability of 0.01 and a waypoint of zeros that has no meaning.
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
        """Return which targets the poser is asked about, in order."""
        if not len(targets):
            return np.empty(0, np.intp)
        likely = self._recogniser.same_place(np.stack([*sources[:, 0]]), np.stack([*targets[:, 0]]))
        chosen = np.flatnonzero(likely >= PROPOSED_R)
        if len(sources) == 1 and len(chosen) > PROPOSED:
            chosen = np.sort(chosen[np.argsort(-likely[chosen], kind="stable")[:PROPOSED]])
        return chosen
