"""Where in a map a single picture was taken: which node, how surely, and how the node lies from there.

Owns the sentence that says so. Comparing is the predictor's, judging the localiser's thresholds; one picture has no way
behind it, so nothing supports it over time.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ltvn_core.analysis.localisation_confidence import localisation_heat_map
from ltvn_core.errors import MapError
from ltvn_core.graph.matching import Matcher
from ltvn_core.preprocessing import preprocess_image
from ltvn_core.recording.reader import Recording
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.types import NodeId, Observation, Pose, Predictor, Rgb, is_usable

_NO_STEP = -1
"""The step of a picture that belongs to no drive."""


class FoundPlace(NamedTuple):
    """What a map says of a picture."""

    node: NodeId | None
    """Where it was taken; None where that is nowhere in the map."""
    best: NodeId
    """The node that it looks most like."""
    reachability: float
    """r from the picture to that node."""
    waypoint: Pose
    """(3,) that node in the picture's frame; metres and radians."""

    @property
    def text(self) -> str:
        """What was found, in words."""
        if self.node is None:
            return (
                f"The picture was taken nowhere in this map: node {self.best} is most like it, with r = "
                f"{self.reachability:.2f}."
            )
        x, y, turn = self.waypoint
        return (
            f"The picture was taken at node {self.node}: r = {self.reachability:.2f}; the node's own view is from "
            f"{abs(x):.2f} m {'ahead' if x >= 0 else 'behind'} and {abs(y):.2f} m {'left' if y >= 0 else 'right'} of "
            f"it, turned by {np.degrees(turn):.0f}°."
        )


class PlaceLookup:
    """Looks for pictures in maps; keeps the map that it looked at last. Use it in the worker's thread alone."""

    def __init__(self) -> None:
        """Begin with no map."""
        self._opened: tuple[tuple[Path, int, str], TopologicalMap] | None = None

    def find(self, path: Path, rgb: Rgb, in_use: Predictor) -> FoundPlace:
        """Look for a picture (H, W, 3) of any size in the map at the end of a recording.

        `in_use` is the predictor at hand, which spares opening the map's own where that is the same. Raises
        RecordingError, MapError, OptionError and WeightsError.
        """
        known = self._map(path, in_use)
        predictor, nodes = known.predictor, list(known.graph.nodes)
        image = preprocess_image(rgb, "the uploaded image", target=predictor.camera)
        seen = Observation(image, None, np.zeros(3), stamp=0.0, step=_NO_STEP)
        if not nodes:
            raise MapError("The map of this recording is empty; press “Build the map anew” (B) to make one from it.")
        if not is_usable(seen, predictor):
            raise MapError(
                f"This map was built by {known.predictor_name or predictor.fingerprint}, which compares nothing "
                "without depth, and a picture has none. Open a map that was built with --predictor geometric."
            )
        matcher = Matcher(predictor, known.keyframes, known.system.method.matching)
        features = predictor.encode([seen])
        heat = localisation_heat_map(features, nodes, matcher, known.system.method.localising)
        best = heat.best(1)[0]
        matched = matcher.match(features, [best])
        is_here = bool(heat.near[heat.nodes.index(best)])
        return FoundPlace(best if is_here else None, best, float(matched.reachability[0]), matched.waypoints[0])

    def _map(self, path: Path, in_use: Predictor) -> TopologicalMap:
        key = path, path.stat().st_mtime_ns, in_use.fingerprint
        if self._opened is None or self._opened[0] != key:
            made_by = Recording.open(path).meta.fingerprint
            predictor = in_use if made_by == in_use.fingerprint else None
            known = TopologicalMap.load(path, predictor, with_reserve=False)
            self._opened = key, known
        return self._opened[1]
