"""Images and goals that no node recognises come into the map by merged images or by odometry; else one is told."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.config import PAPER, ROBUST, Method
from ltvn_core.geometry import relative
from ltvn_core.graph.builder import SECOND_PASS_REACHABILITY, build
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.planner import Planner, strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.map_coverage import GoalReport, Standing, goal_reports, standings
from ltvn_core.types import Features, FrameId, Observation, Prediction
from tests.core.flat_world import FlatPredictor, one_room, tour

NEAR_SIGHTED_M = 0.4
WITHOUT_TURNS = replace(ROBUST, building=replace(ROBUST.building, floor_edges=False))
WITHOUT = replace(ROBUST, building=replace(ROBUST.building, bridges=False))


def line() -> list[Observation]:
    """Images 12 cm apart along 3.5 m."""
    return list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))


def built(images: Sequence[Observation], predictor: FlatPredictor, method: Method = ROBUST) -> TopologicalGraph:
    deltas = build(images, KeyframeStore(predictor), predictor, method, np.random.default_rng(0))
    return TopologicalGraph(deltas)


class GapPredictor(FlatPredictor):
    """Sees nothing in common between images before and after one frame, and nothing at all in blank ones."""

    gap: FrameId = 0
    blank: frozenset[FrameId] = frozenset()

    def predict(self, sources: Features, targets: Features) -> Prediction:
        found = super().predict(sources, targets)
        first, second = np.broadcast_arrays(sources[:, 3], targets[:, 3])
        unlike = (first < self.gap) != (second < self.gap)
        unlike |= np.isin(first, list(self.blank)) | np.isin(second, list(self.blank))
        return Prediction(np.where(unlike, 0.01, found.reachability), found.waypoints)


def gap_predictor(gap: FrameId, blank: Sequence[FrameId] = ()) -> GapPredictor:
    predictor = GapPredictor(one_room())
    predictor.gap, predictor.blank = gap, frozenset(blank)
    return predictor


def blanks(*frames: FrameId) -> GapPredictor:
    return gap_predictor(0, frames)


def test_a_near_sighted_predictor_leaves_no_image_over() -> None:
    images = line()
    short = built(images, FlatPredictor(one_room(), sight_m=NEAR_SIGHTED_M), WITHOUT)
    graph = built(images, FlatPredictor(one_room(), sight_m=NEAR_SIGHTED_M))
    span_m = [np.ptp([node.odometry.x_m for node in each.nodes.values()]) for each in (short, graph)]
    assert span_m[0] < 1.0
    assert span_m[1] > 2.8
    assert len(strongly_connected_components(graph)) == 1
    assert len(graph.nodes) < len(images)


def test_where_images_in_a_row_share_nothing_odometry_joins_them() -> None:
    images = line()
    gap = images[len(images) // 2].step
    graph = built(images, gap_predictor(gap), WITHOUT_TURNS)
    across = [(source, target) for source, target in graph.edges if source < gap <= target]
    (edge,) = across
    poses = {seen.step: seen.odometry for seen in images}
    assert np.allclose(graph.edges[edge].waypoint, relative(poses[edge[0]], poses[edge[1]]))
    assert graph.edges[edge].belief.p <= SECOND_PASS_REACHABILITY
    assert len(strongly_connected_components(graph)) == 1
    sides = {frame < gap for frame in built(images, gap_predictor(gap), PAPER).nodes}
    assert len(sides) == 1


def test_odometry_joins_nothing_across_a_pause_or_a_jump() -> None:
    images = line()
    middle = len(images) // 2
    gap = images[middle].step
    late = [replace(seen, stamp=seen.stamp + 30.0) for seen in images[middle:]]
    away = [replace(seen, odometry=np.add(seen.odometry, [0.0, 3.0, 0.0])) for seen in images[middle:]]
    for rest in (late, away):
        graph = built([*images[:middle], *rest], gap_predictor(gap))
        assert len({frame < gap for frame in graph.nodes}) == 1


def test_an_image_that_nothing_recognises_stays_in_the_reserve() -> None:
    images = line()
    blank = images[len(images) // 2].step
    graph = built(images, gap_predictor(blank, [blank]))
    assert blank in graph.reserve
    assert {frame < blank for frame in graph.nodes} == {True, False}
    assert len(strongly_connected_components(graph)) == 1


def test_a_stretch_that_no_image_shows_cuts_off_nothing_behind_it() -> None:
    images = line()
    bare = [seen.step for seen in images if 1.7 < seen.odometry[0] < 3.2]
    graph = built(images, gap_predictor(bare[0], bare))
    assert {*graph.nodes} & {*bare}
    assert min(graph.nodes) < bare[0]
    assert max(graph.nodes) > bare[-1]
    assert len(strongly_connected_components(graph)) == 1


def built_for(
    images: Sequence[Observation], predictor: FlatPredictor, goal: FrameId, method: Method = ROBUST
) -> tuple[TopologicalGraph, GoalReport]:
    keyframes = KeyframeStore(predictor)
    graph = TopologicalGraph(build(images, keyframes, predictor, method, np.random.default_rng(0), goals=[goal]))
    (report,) = goal_reports(graph, [goal], keyframes, predictor, ltvn_system(method))
    return graph, report


def test_a_goal_that_nothing_recognises_is_tied_in_by_odometry() -> None:
    images = line()
    goal = images[len(images) // 2].step
    graph, report = built_for(images, blanks(goal), goal)

    assert report == GoalReport(goal, Standing.HELD)
    poses = {seen.step: seen.odometry for seen in images}
    (edge, *_) = [key for key in graph.edges if key[0] == goal]
    assert np.allclose(graph.edges[edge].waypoint, relative(poses[edge[0]], poses[edge[1]]))
    assert all(Planner(graph, ROBUST.planning).plan(node, goal).nodes for node in graph.nodes if node != goal)


def test_odometry_is_followed_over_more_than_one_image_that_nothing_recognises() -> None:
    images = line()
    blank = [seen.step for seen in images[-18:]]
    graph, report = built_for(images, blanks(*blank), blank[-1])

    assert report.standing is Standing.HELD
    assert {*graph.nodes} & {*blank[:-1]}
    assert not {*graph.reserve} & {*graph.nodes}


def test_without_tying_it_is_told_and_the_node_most_like_it_named() -> None:
    images = line()
    goal = images[len(images) // 2].step
    _, report = built_for(images, blanks(goal), goal, WITHOUT)

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
    _, report = built_for(alone, blanks(goal), goal)

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
    graph, _ = built_for(line(), blanks(), line()[0].step)
    assert standings(graph, [99_999]) == (Standing.NOT_HELD,)
    assert standings(TopologicalGraph(), [1]) == (Standing.NOT_HELD,)
