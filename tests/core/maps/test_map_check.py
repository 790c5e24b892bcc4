"""A map that nobody can navigate by is told of, and a map in order is not."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.geometry import relative
from ltvn_core.graph.corrections import LOOK_ALIKES, UNSURE
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.built_map import build_map
from ltvn_core.maps.map_check import map_findings, place_findings
from ltvn_core.maps.map_coverage import MapCoverage, map_coverage
from ltvn_core.maps.scale_check import scale_findings
from ltvn_core.types import Features, Observation, Prediction, Tilt
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour
from tests.repository import DEMO_MAP

ALL_KNOWN = MapCoverage(1.0, None)


def test_a_map_of_one_node_is_told(caplog: pytest.LogCaptureFixture) -> None:
    standing = [observation_at(np.array([2.0, 2.0, 0.0]), step) for step in range(30)]
    built = build_map(standing, predictor=FlatPredictor(one_room()))
    assert len(built.graph.nodes) == 1
    (doubt,) = [doubt for doubt in built.doubts if "only one node" in doubt]
    assert "all 30 images seem to show the same place" in doubt
    assert doubt in caplog.text


def test_one_node_that_knows_little_is_not_said_to_be_all_there_was_to_see() -> None:
    alone = TopologicalGraph([NodeAdded(node_from_observation(observation_at(np.zeros(3), 0)), Cause.BUILD)])
    said = " ".join(map(str, map_findings(alone, 199, MapCoverage(0.11, None))))
    assert "only one node" in said
    assert "knows 11%" in said
    assert "one place" not in said
    assert "nearly all 199 images" in " ".join(map(str, map_findings(alone, 199, MapCoverage(0.95, None))))


def test_places_that_look_alike_are_told_where_the_drive_leaves_its_course_unsure() -> None:
    row = [observation_at(np.array([k / 2, 0.0, 0.0]), k) for k in range(200)]
    built = build_map(row, predictor=FlatPredictor(one_room()))
    (unsure,) = (each for each in built.corrections if each.what == UNSURE)
    assert 100 < unsure.count < 200
    alike = replace(unsure, what=LOOK_ALIKES, count=7)
    (told,) = place_findings([unsure, alike], built.unsure, 200)
    assert "7 pairs" in told.text
    assert "from image 0 to image 199" in told.remedy
    assert [*place_findings([unsure], built.unsure, 200), *place_findings([alike], built.unsure, 200)] == []


def test_a_map_of_a_few_images_is_doubted_as_well() -> None:
    near = list(tour([(0.7, 0.7), (2.2, 0.7)], spins=False))[:9]
    far = [replace(seen, stamp=seen.stamp + 60.0) for seen in tour([(0.7, 3.2), (4.2, 3.2)], first_step=300)][:7]
    built = build_map([*near, *far], predictor=FlatPredictor(one_room(), sight_m=1.0))
    assert built.coverage is not None
    assert built.coverage.share < 0.8
    assert any(f"knows {built.coverage.share:.0%}" in doubt for doubt in built.doubts)


def test_a_map_without_edges_is_told() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    apart = TopologicalGraph(NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in images[::10])
    (finding,) = map_findings(apart, len(images), ALL_KNOWN)
    assert f"None of the {len(apart.nodes)} nodes is joined to another" in finding.text


def test_maps_in_order_and_short_drives_are_not_doubted() -> None:
    loaded = load_map(DEMO_MAP)
    assert map_findings(loaded.graph, len(loaded.observations), ALL_KNOWN) == ()
    images = list(tour([(0.7, 0.7), (4.2, 0.7), (4.2, 3.2)]))
    built = build_map(images, predictor=FlatPredictor(one_room()), is_lens_known=False)
    assert built.coverage == ALL_KNOWN
    assert map_findings(built.graph, len(images), ALL_KNOWN) == ()
    assert not any("Likely cause" in doubt for doubt in built.doubts)
    assert map_findings(TopologicalGraph(), 1, ALL_KNOWN) == ()


def test_a_map_in_small_pieces_is_told() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7), (4.2, 3.2)]))
    built = build_map(images, predictor=FlatPredictor(one_room()))
    nodes = list(built.graph.nodes.values())
    pieces = TopologicalGraph(NodeAdded(node, Cause.BUILD) for node in nodes)
    edge = next(iter(built.graph.edges.values()))
    pieces.apply(EdgeAdded(edge, Cause.BUILD))
    (finding,) = map_findings(pieces, len(images), ALL_KNOWN)
    assert f"falls into {len(nodes)} pieces" in finding.text


def test_a_map_that_knows_a_part_of_its_drive_is_told_with_where_it_ends() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    carried = [replace(seen, stamp=seen.stamp + 60.0) for seen in tour([(0.7, 3.2), (4.2, 3.2)], first_step=300)]
    built = build_map([*images, *carried], predictor=FlatPredictor(one_room(), sight_m=1.0))
    assert built.coverage is not None
    (doubt,) = [doubt for doubt in built.doubts if "of its own drive" in doubt]
    assert f"knows {built.coverage.share:.0%}" in doubt
    assert 0 < built.coverage.share < 0.8
    begins = {f"from {run[0].stamp:.1f} s to {run[-1].stamp:.1f} s" for run in (images, carried)}
    assert any(begin in doubt for begin in begins)


class BlindPredictor(FlatPredictor):
    """Calls no pair of images one place."""

    def predict(self, sources: Features, targets: Features) -> Prediction:
        found = super().predict(sources, targets)
        return Prediction(np.zeros_like(found.reachability), found.waypoints)


class NarrowPredictor(BlindPredictor):
    """Finds nothing in its images, for they are too narrow."""

    least_width_px = 160


def test_images_too_small_for_a_predictor_are_named_as_the_cause() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)]))
    built = build_map(images, predictor=NarrowPredictor(one_room()), predictor_name="geometric")
    said = " ".join(built.doubts)
    assert "images are 96 pixels wide" in said
    assert "--predictor network" in said
    assert "--predictor geometric" not in said


def test_why_nothing_came_of_a_drive_is_said_with_what_to_do() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)]))
    tilted = [replace(seen, depth=None, tilt=Tilt(-0.7, 0.0)) for seen in images]
    camera = CameraModel.from_fov(96, 72, np.radians(50))
    built = build_map(tilted, predictor=BlindPredictor(one_room()), camera=camera, is_lens_known=False)
    said = " ".join(built.doubts)
    for cause in ("lens is unknown", f"{len(images)} of {len(images)} images have no depth", "pitched by -40"):
        assert cause in said
    assert "consecutive images are recognised as the same place. The predictor cannot compare" in said
    assert sum("Likely cause" in doubt for doubt in built.doubts) == 4


def test_images_too_far_apart_to_overlap_are_told_from_a_blind_predictor() -> None:
    far = [observation_at(np.array([0.7 + 1.2 * (k % 3), 0.7 + 1.2 * (k // 10), 2.0 * k]), k) for k in range(30)]
    built = build_map(far, predictor=BlindPredictor(one_room()))
    assert any("they hardly overlap" in doubt for doubt in built.doubts)


def test_a_robot_that_never_moved_and_saw_one_thing_is_told_to_drive() -> None:
    rng = np.random.default_rng(0)
    wall = np.linspace(20, 200, 96)[None, :, None] * np.ones((72, 1, 3))
    images = [
        replace(
            observation_at(np.array([2.0, 2.0, 0.01 * k]), k),
            rgb=(wall + rng.normal(0, 3, wall.shape)).astype(np.uint8),
        )
        for k in range(25)
    ]
    said = " ".join(build_map(images, predictor=FlatPredictor(one_room())).doubts)
    assert "stayed within 0.5 m" in said
    assert "all images look alike" in said


def test_a_drive_without_odometry_is_joined_by_what_its_images_say_alone() -> None:
    images = [replace(seen, odometry=np.zeros(3)) for seen in tour([(0.7, 0.7), (4.2, 0.7), (4.2, 3.2)])]
    built = build_map(images, predictor=FlatPredictor(one_room()))
    assert len(built.graph.nodes) > 5
    assert len(strongly_connected_components(built.graph)) == 1


def passed_later(images: list[Observation], steps: int, seconds: float) -> list[Observation]:
    """Return the images of the same places, taken again."""
    return [replace(seen, step=seen.step + steps, stamp=seen.stamp + seconds) for seen in images]


def test_a_stretch_that_is_driven_once_is_named_one_way_only_and_one_driven_twice_is_not() -> None:
    here = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    there = passed_later(list(tour([(0.7, 3.2), (4.2, 3.2)], spins=False)), 300, 60.0)
    once = [*here, *there]
    twice = [*here, *passed_later(here, 150, 30.0), *there, *passed_later(there, 150, 30.0)]
    predictor = FlatPredictor(one_room(), sight_m=1.0)
    said = [" ".join(build_map(drive, predictor=predictor).doubts) for drive in (once, twice)]
    assert ["of its own drive" in words for words in said] == [True, True]
    assert ["one direction only" in words for words in said] == [True, False]


class PoorPredictor(BlindPredictor):
    """Finds hardly any key points."""

    def key_point_counts(self, features: Features) -> np.ndarray:
        return np.full(len(features), 87)


def test_few_key_points_are_named_with_their_number() -> None:
    doubts = build_map(tour([(0.7, 0.7), (4.2, 0.7)]), predictor=PoorPredictor(one_room())).doubts
    assert any("few key points (87 per image" in doubt for doubt in doubts)


def test_a_drive_without_odometry_is_not_told_to_be_thinned_less_by_metres() -> None:
    images = [replace(seen, odometry=np.zeros(3)) for seen in tour([(0.7, 0.7), (4.2, 0.7)])]
    # Two far parts of the room, of which no image sees the other.
    far = [replace(seen, odometry=np.zeros(3), step=seen.step + 500) for seen in tour([(0.7, 3.2), (4.2, 3.2)])]
    mixed = [seen for pair in zip(images, far, strict=False) for seen in pair]
    mixed = [replace(seen, step=k, stamp=0.1 * k) for k, seen in enumerate(mixed)]
    said = " ".join(build_map(mixed, predictor=FlatPredictor(one_room(), sight_m=0.4)).doubts)
    assert "Likely cause" in said
    assert "thin less" not in said


def test_what_odometry_alone_holds_together_is_counted_and_doubted() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7), (4.2, 3.2)], spins=False))
    built = build_map(images, predictor=FlatPredictor(one_room()))
    middle = images[len(images) // 2].step
    edges = built.graph.edges.values()
    crossing = [replace(edge, by_odometry=(edge.source < middle) != (edge.target < middle)) for edge in edges]
    nodes = [NodeAdded(node, Cause.BUILD) for node in built.graph.nodes.values()]
    joined = TopologicalGraph([*nodes, *(EdgeAdded(edge, Cause.BUILD) for edge in crossing)])
    coverage = map_coverage(images, joined, built.keyframes, built.predictor, built.system)
    assert coverage.share == 1
    assert 0.3 < coverage.by_images < 0.75
    (doubt,) = map_findings(joined, len(images), coverage)
    assert f"{coverage.by_images:.0%}" in doubt.text


@pytest.mark.parametrize(("scale", "is_told"), [(1.0, False), (0.49, True), (1.6, True)])
def test_one_factor_between_images_and_odometry_is_doubted(scale: float, is_told: bool) -> None:
    images = [observation_at(np.array([0.25 * k, 0.02 * k, 0.0]), k) for k in range(40)]
    graph = TopologicalGraph(NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in images)
    rng = np.random.default_rng(0)
    for source, target in ((k, k + 2) for k in range(38)):
        move = relative(images[source].odometry, images[target].odometry)
        waypoint = pose_row(move * [*np.full(2, scale * (0.95, 1.0, 1.05)[source % 3]), 1.0])
        graph.apply(EdgeAdded(Edge(source, target, waypoint, Belief(0.9, 0.5, 0.1)), Cause.BUILD))
    told = [finding.text for finding in scale_findings(graph, images)]
    assert [f"{scale:.2f}" in text for text in told] == [True] * is_told
    at_random = [replace(seen, odometry=seen.odometry * rng.uniform(0.3, 1.7)) for seen in images]
    assert not [*scale_findings(graph, at_random)]  # No one factor explains these.
