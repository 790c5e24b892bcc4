"""What a program asks of a map: where a picture was taken, and an action that joins two nodes."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import ImageError, MapError, OptionError
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.types import Observation
from tests.core.flat_world import FlatPredictor, one_room, tour
from tests.repository import DEMO_MAP


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


ROUND = [(0.7, 0.7), (2.2, 0.7)]


def test_images_that_are_made_one_by_one_give_the_same_map_as_a_list() -> None:
    images = list(tour(ROUND, spins=False))
    listed = build_map(images, predictor=FlatPredictor(one_room()))
    streamed = build_map(iter(images), predictor=FlatPredictor(one_room()))
    assert streamed.graph.nodes == listed.graph.nodes
    assert streamed.graph.edges == listed.graph.edges


@pytest.mark.parametrize("given", ["drive.rrd", [3, 4], [(np.zeros((4, 4, 3)), None)], 7, None])
def test_what_is_no_list_of_images_is_refused_with_how_to_make_one(given: object) -> None:
    with pytest.raises(MapError, match=r"\[recording\.observation\(frame\) for frame in recording\.frames\]"):
        build_map(given, predictor=FlatPredictor(one_room()))  # type: ignore[arg-type]


def test_a_recording_in_place_of_its_images_is_refused() -> None:
    with pytest.raises(MapError, match="not from Recording"):
        build_map(Recording.open(DEMO_MAP), predictor=FlatPredictor(one_room()))  # type: ignore[arg-type]


@pytest.mark.parametrize("fault", [{"odometry": np.array([np.nan, 0, 0])}, {"odometry": np.eye(4)}, {"stamp": 1.7e18}])
def test_an_image_whose_moment_cannot_be_is_named_by_its_number(fault: dict[str, object]) -> None:
    images = list(tour(ROUND, spins=False))
    images[5] = replace(images[5], **fault)  # type: ignore[arg-type]
    with pytest.raises(ImageError, match=f"^image {images[5].step}: "):
        build_map(images, predictor=FlatPredictor(one_room()))
