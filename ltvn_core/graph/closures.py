"""Loop closures: an edge between two passes of a drive must hold along a stretch of both, not at one place alone.

Two rooms may look alike from one place; what is seen a metre on, or after a turn, tells them apart. Odometry over so
short a stretch is exact, so the edge foretells how the images around its ends lie to each other, and the network is
asked whether they do. Owns that question (ours). Images close in time need no such proof.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Matching
from ltvn_core.geometry import compose, distance, invert, relative, wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.views import Views
from ltvn_core.types import FrameId, Predictor, Waypoint

_PAIRS = 8
"""So many pairs of images are asked about one edge, those farthest from its ends."""
_FEWEST = 3
"""Where fewer could see each other, nothing can be said."""
_NEAR = 0.9
"""Images that should lie within this d are asked about."""
_GAP_M, _GAP_RAD = 0.35, 0.35
"""An answer may be off by so much."""
_LEAST_R = 0.5


class Closures:
    """Checks edges of one drive."""

    def __init__(self, predictor: Predictor, views: Views, config: Matching) -> None:
        """Compare images in `views`, which hold the whole drive."""
        self._predictor, self._views, self._config = predictor, views, config

    def proven(self, frame: FrameId, matches: Matches, asked: NDArray[np.bool_]) -> Matches:
        """Return the matches of a held frame; those of `asked` (N,) that do not hold along the drive lose all trust."""
        reach = self._config.closure_reach
        trusted = matches.reachability.copy()
        for k in np.flatnonzero(asked) if reach else ():
            if not self._holds(frame, matches.nodes[k], matches.waypoints[k], reach):
                trusted[k] = 0.0
        return matches.with_reachability(trusted)

    def _holds(self, frame: FrameId, node: FrameId, waypoint: Waypoint, reach: int) -> bool:
        here, there = self._views.around(frame, reach), self._views.around(node, reach)
        if node in here:
            return True
        first, second, expected = self._foretold(frame, node, waypoint, here, there)
        if len(first) < _FEWEST:
            return True
        agreed = self._agree([here[k] for k in first], [there[k] for k in second], expected)
        return bool(agreed.mean() >= self._config.closure_share)

    def _foretold(
        self, frame: FrameId, node: FrameId, waypoint: Waypoint, here: tuple[FrameId, ...], there: tuple[FrameId, ...]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Waypoint]:
        """Return which images around both ends should see each other, and how they should lie, (P, 3)."""
        from_frame, from_node = self._moved(frame, here), self._moved(node, there)
        lie = relative(from_frame[:, None], compose(waypoint, from_node)[None])
        apart = distance(lie)
        far = np.linalg.norm(from_frame, axis=-1)[:, None] + np.linalg.norm(from_node, axis=-1)[None]
        first, second = np.nonzero(apart < _NEAR)
        order = np.argsort(-far[first, second], kind="stable")
        # Not one image over and over: each takes part once.
        chosen, taken = list[int](), set[tuple[str, int]]()
        for k in order:
            ends = {("first", int(first[k])), ("second", int(second[k]))}
            if not ends & taken and len(chosen) < _PAIRS:
                chosen.append(int(k))
                taken |= ends
        rows = np.array(chosen, np.intp)
        return first[rows], second[rows], lie[first[rows], second[rows]]

    def _moved(self, frame: FrameId, others: tuple[FrameId, ...]) -> Waypoint:
        """Return (K, 3) where odometry puts other images, seen from a frame."""
        odometry = np.array([self._views.observation(other).odometry for other in others])
        return relative(self._views.observation(frame).odometry, odometry)

    def _agree(self, first: list[FrameId], second: list[FrameId], expected: Waypoint) -> NDArray[np.bool_]:
        """Tell for P pairs of images whether the network sees them as they should lie, one way or the other."""
        sources, targets = self._views.features(first), self._views.features(second)
        answers = self._predictor.predict(np.concatenate([sources, targets]), np.concatenate([targets, sources]))
        count = len(first)
        ahead = answers.reachability[:count] >= answers.reachability[count:]
        reachability = np.maximum(answers.reachability[:count], answers.reachability[count:])
        waypoints = np.where(ahead[:, None], answers.waypoints[:count], invert(answers.waypoints[count:]))
        gap = relative(expected, waypoints)
        near = (np.hypot(gap[:, 0], gap[:, 1]) < _GAP_M) & (np.abs(wrap_angle(gap[:, 2])) < _GAP_RAD)
        return near & (reachability > _LEAST_R)
