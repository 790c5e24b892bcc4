"""A map is built from the images that have depth; the others are counted and said."""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import ROBUST, Method
from ltvn_core.errors import MapError
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import OnlineBuilder, ltvn_system
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.system_table import SPTM, VING
from ltvn_core.types import Depth, FrameId, Observation
from tests.core.flat_world import FlatPredictor, one_room, tour
from tests.core.navigation.blind_world import NO_DEPTH, DepthPredictor

ROUND = [(0.7, 0.7), (4.2, 0.7), (4.2, 3.2), (0.7, 0.7)]
DEPTHS = pytest.mark.parametrize("depth", NO_DEPTH.values(), ids=NO_DEPTH.keys())


def drive(depth: Depth | None, every: int = 4) -> list[Observation]:
    images = list(tour(ROUND, spins=False))
    return [replace(seen, depth=depth) if k % every == 1 else seen for k, seen in enumerate(images)]


def blind_frames(images: list[Observation]) -> list[FrameId]:
    return [seen.step for seen in images if not seen.has_depth]


@pytest.mark.parametrize(
    ("system", "depth"),
    [(ltvn_system, NO_DEPTH["zero"]), (ltvn_system, NO_DEPTH["absent"]), (SPTM.factory, None), (VING.factory, None)],
)
def test_no_system_makes_a_node_of_an_image_without_depth(
    system: Callable[[Method], NavigationSystem], depth: Depth | None, caplog: pytest.LogCaptureFixture
) -> None:
    images, predictor = drive(depth), DepthPredictor(one_room())
    blind = blind_frames(images)

    with caplog.at_level(logging.WARNING):
        deltas = system(ROBUST).build(images, KeyframeStore(predictor), predictor, rng=np.random.default_rng(0))

    graph = TopologicalGraph(deltas)
    assert len(graph.nodes) > 3
    assert not {*graph.nodes, *graph.reserve} & set(blind)
    assert f"{len(blind)} of {len(images)} images have no depth (the first is frame {blind[0]})" in caplog.text


@DEPTHS
def test_a_drive_without_any_depth_is_refused_with_the_cure(depth: Depth | None) -> None:
    predictor = DepthPredictor(one_room())
    with pytest.raises(MapError, match="Is the depth camera running"):
        ltvn_system(ROBUST).build(
            [seen for seen in drive(depth) if not seen.has_depth],
            KeyframeStore(predictor),
            predictor,
            rng=np.random.default_rng(0),
        )


def test_a_goal_without_depth_is_refused_by_its_number() -> None:
    images, predictor = drive(None), DepthPredictor(one_room())
    goal = blind_frames(images)[0]
    with pytest.raises(MapError, match=rf"goal frames \[{goal}\] have no depth"):
        ltvn_system(ROBUST).build(
            images, KeyframeStore(predictor), predictor, rng=np.random.default_rng(0), goals=[goal]
        )


def test_a_predictor_that_works_from_colours_gets_all_images() -> None:
    images, predictor = drive(None), FlatPredictor(one_room())
    SPTM.factory(ROBUST).build(images, KeyframeStore(predictor), predictor, rng=np.random.default_rng(0))
    assert predictor.encoded == len(images)


@DEPTHS
def test_a_growing_map_leaves_images_without_depth_out(depth: Depth | None) -> None:
    predictor, graph = DepthPredictor(one_room()), TopologicalGraph()
    keyframes = KeyframeStore(predictor)
    online = OnlineBuilder(graph, keyframes, predictor, ROBUST)
    images = drive(depth)
    for seen in images:
        for delta in online.offer(seen):
            graph.apply(delta)
    assert len(graph.nodes) > 3
    assert not set(keyframes.frames) & set(blind_frames(images))
