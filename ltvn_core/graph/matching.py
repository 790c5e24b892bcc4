"""One image against many: reachability, waypoint and distance, with temporal support where it matters.

Owns how the network is asked. Does not decide what a match means: `graph.operators` and `graph.localizer` do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Matching
from ltvn_core.geometry import distance, invert
from ltvn_core.graph.views import Views
from ltvn_core.types import Features, FrameId, NodeId, Predictor, Waypoint


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """What the network says of one image and N nodes."""

    nodes: tuple[NodeId, ...]
    """N nodes."""
    reachability: NDArray[np.float64]
    """(N,) in [0, 1]."""
    waypoints: Waypoint
    """(N, 3): the nodes in the image's frame."""
    distances: NDArray[np.float64]
    """(N,): d(w), Eq. 2."""

    def __len__(self) -> int:
        return len(self.nodes)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> "Matches":
        """Return the chosen ones: a mask (N,) or indices."""
        kept = np.arange(len(self))[chosen]
        nodes = tuple(self.nodes[k] for k in kept)
        return Matches(nodes, self.reachability[kept], self.waypoints[kept], self.distances[kept])

    def with_reachability(self, reachability: NDArray[np.float64]) -> "Matches":
        """Return the same matches, trusted differently."""
        return Matches(self.nodes, reachability, self.waypoints, self.distances)


class Matcher:
    """Asks the network about pairs of images whose features are at hand."""

    def __init__(self, predictor: Predictor, views: Views, config: Matching) -> None:
        """Compare against the images in `views`."""
        self._predictor = predictor
        self._views = views
        self._config = config

    @property
    def views(self) -> Views:
        """The images that can be compared against."""
        return self._views

    def match(self, image: Features, nodes: Sequence[NodeId]) -> Matches:
        """Compare an image (1, F) with the images of `nodes` in one batch."""
        if not nodes:
            return Matches((), np.empty(0), np.empty((0, 3)), np.empty(0))
        reachability, waypoints = self._ask(image, self._views.features(nodes))
        distances = np.where(_says_nothing(reachability, waypoints), np.inf, distance(waypoints))
        return Matches(tuple(nodes), reachability, waypoints, distances)

    def supported(self, matches: Matches, frame: FrameId) -> Matches:
        """Return `matches` of a held frame, each r lowered to the 3 x 3 median over both images' neighbours in time.

        A false match between look-alike places rarely survives a step to either side, a true one does.
        """
        if not self._config.temporal_support or not len(matches):
            return matches
        own = (frame, *self._views.neighbours(frame, self._config.support_gap))
        images = [self._views.features([one]) for one in own]
        return matches.with_reachability(self._median(images, matches))

    def witnessed(self, matches: Matches, image: Features) -> Matches:
        """Return `matches` of a fresh image (1, F), each r lowered to the median over the nodes' neighbours in time."""
        if not self._config.temporal_support or not len(matches):
            return matches
        return matches.with_reachability(self._median([image], matches))

    def _median(self, images: Sequence[Features], matches: Matches) -> NDArray[np.float64]:
        around = [(n, *self._views.neighbours(n, self._config.support_gap)) for n in matches.nodes]
        targets = self._views.features([frame for group in around for frame in group])
        values = np.stack([self._ask(image, targets)[0] for image in images])  # (images, targets)
        ends = np.cumsum([len(group) for group in around])[:-1]
        medians = np.array([np.median(part) for part in np.split(values, ends, axis=1)])
        return np.minimum(matches.reachability, medians)

    def _ask(self, image: Features, targets: Features) -> tuple[NDArray[np.float64], Waypoint]:
        forward = self._predictor.predict(image, targets)
        if not self._config.both_directions:
            return np.asarray(forward.reachability), np.asarray(forward.waypoints)
        reachability, waypoints = np.array(forward.reachability), np.array(forward.waypoints)
        # What the predictor did not look at closely one way it need not look at the other way.
        close = np.flatnonzero(~_says_nothing(reachability, waypoints))
        backward = self._predictor.predict(targets[close], np.repeat(image, len(close), axis=0))
        better = backward.reachability > reachability[close]
        reachability[close[better]] = backward.reachability[better]
        waypoints[close[better]] = invert(backward.waypoints[better])
        return reachability, waypoints


def _says_nothing(reachability: NDArray[np.float64], waypoints: Waypoint) -> NDArray[np.bool_]:
    """Tell (N,) which pairs a predictor passed over: it calls them unreachable and gives a waypoint of zeros."""
    return (reachability < 0.5) & ~waypoints.any(axis=1)
