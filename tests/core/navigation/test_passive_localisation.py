"""Where images were taken that nobody drives by: each is found in the map, or nowhere."""

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.geometry import relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.passive_localisation import PassiveLocaliser
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour

WAY = [(0.7, 0.7), (2.7, 0.7)]


def test_a_second_drive_is_found_in_the_map_of_the_first_and_elsewhere_is_nowhere() -> None:
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    images = list(tour(WAY, spins=False))
    graph = TopologicalGraph(build(images, keyframes, predictor, ROBUST, np.random.default_rng(0)))
    localiser = PassiveLocaliser(graph, keyframes, predictor, ltvn_system(ROBUST))
    for x in np.arange(0.8, 2.6, 0.3):
        pose = np.array([x, 0.75, 0.1])
        found = localiser.localise(observation_at(pose, 1000 + int(10 * x), relative(np.array([3.0, 1.0, 2.0]), pose)))
        assert found is not None
        assert found.node is not None
        place = keyframes.observation(found.node).odometry
        assert np.hypot(*(place - pose)[:2]) < 0.72
    away = localiser.localise(observation_at(np.array([4.2, 3.2, 1.5]), 2000))
    assert away is not None
    assert away.node is None
