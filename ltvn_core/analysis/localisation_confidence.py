"""Where the robot thinks it is, and how sure that is: the current view against every node, and the margin over time.

Owns the numbers behind the heat map and the curve. Places that look alike are `analysis.perceptual_aliases`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import LocalisingConfig
from ltvn_core.graph.matching import Matcher
from ltvn_core.navigation.events import Localised, StampedEvent
from ltvn_core.types import Features, NodeId, Observation, Predictor

_LEAST_R = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationHeatMap:
    """One view against N nodes."""

    nodes: tuple[NodeId, ...]
    """N nodes."""
    distances: NDArray[np.float64]
    """(N,): d to each node, Eq. 2; infinite where the predictor passed over the pair."""
    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    scores: NDArray[np.float64]
    """(N,): what the localiser compares, d - weight * ln r; the lowest wins. Temporal support comes on top of it."""
    near: NDArray[np.bool_]
    """(N,): d < D_l and r above its cut, so the robot may be there."""

    def best(self, count: int) -> tuple[NodeId, ...]:
        """Return the `count` nodes with the lowest scores, best first."""
        return tuple(self.nodes[k] for k in np.argsort(self.scores, kind="stable")[:count])

    @property
    def margin(self) -> float:
        """Score of the second best minus score of the best; infinite with fewer than two nodes."""
        if len(self.nodes) < 2:
            return float("inf")
        first, second = np.partition(self.scores, 1)[:2]
        return float(second - first) if np.isfinite(first) else 0.0


def localisation_heat_map(
    features: Features, nodes: Sequence[NodeId], matcher: Matcher, config: LocalisingConfig
) -> LocalisationHeatMap:
    """Compare a view (1, F) with every node in one batch, for a heat map.

    Costs one match with N nodes; their features come from the matcher's views. No nodes give an empty result.
    """
    found = matcher.match(features, nodes)
    doubt = -np.log(np.maximum(found.reachability, _LEAST_R))
    near = (found.distances < config.distance) & (found.reachability > config.reachability)
    scores = found.distances + config.reachability_weight * doubt
    return LocalisationHeatMap(
        nodes=found.nodes,
        distances=found.distances,
        reachability=found.reachability,
        scores=scores,
        near=near,
    )


def features_of(observation: Observation, matcher: Matcher, predictor: Predictor) -> Features:
    """Return the features (1, F) of a view, encoded only if the matcher's views do not hold it."""
    keyframes = matcher.keyframes
    return keyframes.features([observation.step]) if observation.step in keyframes else predictor.encode([observation])


@dataclass(frozen=True, slots=True, eq=False)
class LocalisationMargins:
    """How sure each of M localisations was, as columns in the order of the events."""

    steps: NDArray[np.int64]
    """(M,)."""
    stamps: NDArray[np.float64]
    """(M,) seconds on the robot's clock."""
    margins: NDArray[np.float64]
    """(M,): score of the second best minus score of the best; infinite without a second."""
    distances: NDArray[np.float64]
    """(M,): d of the best node."""
    nodes: tuple[NodeId | None, ...]
    """M nodes; None where the robot was lost."""


def localisation_margins(events: Iterable[StampedEvent]) -> LocalisationMargins:
    """Return best against second over time, from the localisations among the events. Linear in the events."""
    found = [(stamped.step, stamped.stamp, stamped.event) for stamped in events if isinstance(stamped.event, Localised)]
    return LocalisationMargins(
        steps=np.array([step for step, _, _ in found], np.int64),
        stamps=np.array([stamp for _, stamp, _ in found], np.float64),
        margins=np.array([localised.margin for _, _, localised in found], np.float64),
        distances=np.array([localised.distance for _, _, localised in found], np.float64),
        nodes=tuple(localised.node for _, _, localised in found),
    )
