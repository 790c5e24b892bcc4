"""The truth is laid over a map: what is spurious, what is missing, and whether p keeps its promise."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.edge_accuracy import attempt_calibration, calibration_attempts, edge_accuracy
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.evaluation.reports.map_svg import recorded_ground_truth
from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.navigation.events import AttemptEnd, AttemptEnded, GraphChanged, Outcome, QueryEnded, StampedEvent
from tests.core.evaluation.ground_truth_map import map_with_edges, observation_of, truth
from tests.core.simulation.fake_scene import BoxScene
from tests.repository import DEMO_DRIVE


def test_an_edge_through_the_wall_is_spurious_and_costs_precision() -> None:
    found = edge_accuracy(map_with_edges((1, 2), (2, 1), (5, 6), (2, 3), (3, 2)), truth(), near=2.0)
    assert found.spurious == {(5, 6)}
    assert found.precision == pytest.approx(4 / 5)


def test_neighbours_without_a_short_path_are_missing() -> None:
    whole = map_with_edges((1, 2), (2, 1), (2, 3), (3, 2), (3, 4), (4, 3), nodes=(1, 2, 3, 4))
    near = 1.7  # Of 1, 2, 3 and 4 in a row, those beside each other.
    assert edge_accuracy(whole, truth(), near=near).missing == ()
    whole.apply(EdgePruned(2, 3, Cause.ATTEMPT))
    found = edge_accuracy(whole, truth(), near=near)
    assert [(pair.source, pair.target, pair.path) for pair in found.missing] == [(2, 3, np.inf)]
    assert (found.neighbours, found.linked) == (6, 5)
    assert found.recall == pytest.approx(5 / 6)


def test_a_short_way_around_makes_up_for_an_edge() -> None:
    graph = map_with_edges((1, 2), (2, 3), (3, 2), (2, 1))
    found = edge_accuracy(graph, truth(), near=3.0)
    assert (1, 3) not in {(pair.source, pair.target) for pair in found.missing}


def test_an_empty_map_has_neither_precision_nor_recall() -> None:
    found = edge_accuracy(map_with_edges(nodes=()), truth(), near=2.0)
    assert (found.precision, found.recall, found.missing) == (None, None, ())


def attempt_ended(query: int, source: int, target: int, frame: int, *, succeeded: bool) -> StampedEvent:
    ended = AttemptEnded(query, 1, source, target, frame, AttemptEnd.REACHED, 0.1, 0.9, succeeded, "")
    return StampedEvent(10 + query, 1.0 + query, ended)


def end(query: int) -> StampedEvent:
    return StampedEvent(10 + query, 1.0 + query, QueryEnded(query, 3, Outcome.ARRIVED, 10, 0, 1.0))


def test_calibration_grows_with_the_attempts_and_knows_who_was_wrong() -> None:
    built = [StampedEvent(0, 0.0, GraphChanged(delta)) for delta in map_with_edges((1, 2), (5, 6), p=0.8).deltas()]
    known = truth()
    # Image 2 is taken at the end of the first attempt, and image 5 on the wrong side of the wall at the second.
    events = [
        *built,
        attempt_ended(0, 1, 2, 2, succeeded=True),
        end(0),
        attempt_ended(1, 5, 6, 5, succeeded=True),
        end(1),
    ]
    attempts = calibration_attempts(events, known)
    first, second = attempt_calibration(attempts[:1]), attempt_calibration(attempts)
    assert first is not None
    assert second is not None
    assert (first.attempts, first.succeeded, first.arrived, first.mean_p) == (1, 1.0, 1.0, pytest.approx(0.8))
    assert (second.attempts, second.succeeded, second.arrived) == (2, 1.0, 0.5)
    assert first.brier == pytest.approx(0.04)
    assert second.brier == pytest.approx((0.04 + 0.64) / 2)


def test_without_truth_the_robots_own_judgement_counts() -> None:
    built = [StampedEvent(0, 0.0, GraphChanged(delta)) for delta in map_with_edges((1, 2), p=0.8).deltas()]
    events = [*built, attempt_ended(0, 1, 2, 99, succeeded=False), attempt_ended(0, 3, 4, 99, succeeded=True), end(0)]
    only = attempt_calibration(calibration_attempts(events))
    assert only is not None
    assert (only.attempts, only.succeeded, only.arrived) == (1, 0.0, None)
    assert only.brier == pytest.approx(0.64)
    nobody = GroundTruth(BoxScene().clearance, lambda node: replace(observation_of(1), exact_pose=None))
    assert calibration_attempts(events, nobody)[0].arrived is None


def test_fifty_thousand_events_out_of_order_are_counted_whole() -> None:
    built = [StampedEvent(0, 0.0, GraphChanged(delta)) for delta in map_with_edges((1, 2), p=0.8).deltas()]
    many = [each for query in range(25_000) for each in (attempt_ended(query, 1, 2, 2, succeeded=True), end(query))]
    assert len(calibration_attempts([*built, built[-1], *many])) == 25_000


def test_the_demo_drive_is_calibrated_by_its_own_poses() -> None:
    recording = Recording.open(DEMO_DRIVE)
    known = recorded_ground_truth(recording, recording.final_graph())
    assert known is not None
    attempts = calibration_attempts(recording.events, known)
    calibration = attempt_calibration(attempts)
    assert {each.query for each in attempts} == {0, 1}
    assert calibration is not None
    assert calibration.attempts > 40
    assert calibration.arrived is not None
    assert calibration.arrived > 0.9
