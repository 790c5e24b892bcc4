"""Localises the images of a recorded drive, or of a robot under other control, in a map. Drives nothing."""

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import Localisation, LocalisationPrior
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.place_tracker import PlaceTracker
from ltvn_core.types import Observation, Predictor, is_usable


class PassiveLocaliser:
    """Localises images one by one, as the navigator does at the beginning of a query."""

    def __init__(
        self, graph: TopologicalGraph, keyframes: KeyframeStore, predictor: Predictor, system: NavigationSystem
    ) -> None:
        """Localise in `graph`, which is not changed."""
        self._graph = graph
        self._predictor = predictor
        self._system = system
        self._matcher = Matcher(predictor, keyframes, system.method.matching)
        self._places = PlaceTracker(graph, self._matcher, system)

    def localise(self, seen: Observation) -> Localisation | None:
        """Return where the next image of the drive was taken; None if it cannot be compared, such as an image without
        depth."""
        if not is_usable(seen, self._predictor):
            return None
        features = self._predictor.encode([seen])
        self._places.observe(seen.odometry, features)
        place = self._places.place(seen.odometry)
        return self._system.localise(features, self._graph, LocalisationPrior(place=place), self._matcher)
