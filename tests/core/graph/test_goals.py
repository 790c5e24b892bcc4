"""A goal that nothing recognises is tied into the map where that is honest, and else one is told."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.config import ROBUST, Method
from ltvn_core.geometry import relative
from ltvn_core.graph.builder import build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.map_coverage import GoalReport, Standing, goal_reports, standings
from ltvn_core.types import Features, FrameId, Observation, Prediction
from tests.core.flat_world import FlatPredictor, one_room, tour

WITHOUT = replace(ROBUST, building=replace(ROBUST.building, bridges=False))


class BlankPredictor(FlatPredictor):
    """Recognises nothing in some frames."""

    blank: frozenset[FrameId] = frozenset()

    def predict(self, sources: Features, targets: Features) -> Prediction:
        found = super().predict(sources, targets)
        first, second = np.broadcast_arrays(sources[:, 3], targets[:, 3])
        unlike = np.isin(first, list(self.blank)) | np.isin(second, list(self.blank))
        return Prediction(np.where(unlike, 0.01, found.reachability), found.waypoints)


def line() -> list[Observation]:
    """Images 12 cm apart along 3.5 m."""
    return list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))


def blanks(*frames: FrameId) -> BlankPredictor:
    predictor = BlankPredictor(one_room())
    predictor.blank = frozenset(frames)
    return predictor


def built(
    images: Sequence[Observation], predictor: FlatPredictor, goal: FrameId, method: Method = ROBUST
) -> tuple[TopologicalGraph, GoalReport]:
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(images, keyframes, predictor, method, np.random.default_rng(0), goals=[goal]))
    (report,) = goal_reports(graph, [goal], keyframes, predictor, ltvn_system(method))
    return graph, report


def test_a_goal_that_nothing_recognises_is_tied_in_by_odometry() -> None:
    images = line()
    goal = images[len(images) // 2].step
    graph, report = built(images, blanks(goal), goal)

    assert report == GoalReport(goal, Standing.HELD)
    poses = {seen.step: seen.odometry for seen in images}
    (edge, *_) = [key for key in graph.edges if key[0] == goal]
    assert np.allclose(graph.edges[edge].waypoint, relative(poses[edge[0]], poses[edge[1]]))
    assert all(Planner(graph, ROBUST.planning).plan(node, goal).nodes for node in graph.nodes if node != goal)


def test_odometry_is_followed_over_more_than_one_image_that_nothing_recognises() -> None:
    images = line()
    blank = [seen.step for seen in images[-18:]]
    graph, report = built(images, blanks(*blank), blank[-1])

    assert report.standing is Standing.HELD
    assert {*graph.nodes} & {*blank[:-1]}
    assert not {*graph.reserve} & {*graph.nodes}


def test_without_tying_it_is_told_and_the_node_most_like_it_named() -> None:
    images = line()
    goal = images[len(images) // 2].step
    _, report = built(images, blanks(goal), goal, WITHOUT)

    assert report.standing is Standing.NOT_HELD
    # Beside it on the drive, whatever else may look like it.
    assert report.nearest is not None
    assert abs(report.nearest - goal) <= 50
    assert f"does not contain goal {goal}" in str(report.finding)
    assert f"node {report.nearest}" in str(report.finding)


def test_where_odometry_jumps_a_goal_that_nothing_recognises_is_not_held() -> None:
    images = line()
    goal = images[len(images) // 2].step
    alone = [
        replace(seen, odometry=np.add(seen.odometry, [0.0, 3.0, 0.0])) if seen.step == goal else seen for seen in images
    ]
    _, report = built(alone, blanks(goal), goal)

    assert report.standing is Standing.NOT_HELD


def test_a_map_says_of_each_goal_how_it_stands_when_it_is_built() -> None:
    images = line()
    goal = images[len(images) // 2].step
    predictor = blanks(goal)
    for method, expected in ((ROBUST, Standing.HELD), (WITHOUT, Standing.NOT_HELD)):
        made = build_map(images, predictor=predictor, system=ltvn_system(method), goals=[goal])
        assert [report.standing for report in made.goals] == [expected]
        assert any(f"goal {goal}" in doubt for doubt in made.doubts) == (expected is Standing.NOT_HELD)


def test_goals_that_are_no_frames_of_the_map_are_not_held() -> None:
    graph, _ = built(line(), blanks(), line()[0].step)
    assert standings(graph, [99_999]) == (Standing.NOT_HELD,)
    assert standings(TopologicalGraph(), [1]) == (Standing.NOT_HELD,)
