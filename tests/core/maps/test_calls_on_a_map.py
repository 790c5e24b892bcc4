"""What a program asks of a map: where a picture was taken, and an action that joins two nodes."""

import numpy as np
import pytest

from ltvn_core.errors import MapError, OptionError
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, one_room, tour


def images() -> list[Observation]:
    return list(tour([(0.7, 0.7), (2.4, 0.7), (2.4, 2.0)], spins=False))


@pytest.fixture
def known() -> TopologicalMap:
    return build_map(images(), predictor=FlatPredictor(one_room()))


def test_a_picture_is_found_where_it_was_taken(known: TopologicalMap) -> None:
    picture = images()[7]

    found = known.find(picture, count=2)

    assert len(found) == 2
    assert found[0].reachability > 0.5
    seen = known.keyframes.observation(found[0].node)
    assert np.hypot(*(seen.odometry - picture.odometry)[:2]) < 1.0
    assert np.hypot(*found[0].waypoint[:2]) <= np.hypot(*found[1].waypoint[:2]) + 0.5
    with pytest.raises(MapError, match="no nodes"):
        TopologicalMap.of(known.predictor, known.system).find(picture)


def test_an_action_joins_two_nodes_in_one_direction(known: TopologicalMap) -> None:
    first, *_, last = known.graph.nodes
    known.connect(first, last, action="Take the lift", cost_m=30)

    edge = known.graph.edges[first, last]
    assert (edge.action, edge.belief.mu, edge.protected) == ("Take the lift", 30.0, True)
    with pytest.raises(MapError, match="not in the map"):
        known.connect(first, -1, action="Take the lift")
    with pytest.raises(OptionError, match="action"):
        known.connect(last, first, action="")
