"""A drive labels itself by odometry: sure of neighbours in time, unsure after drift, and blind to the truth."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.errors import ImageError, RecordingError
from ltvn_core.network.training_data.reachability_labels import ReachabilityLimits, label_poses
from ltvn_core.network.training_data.trajectory import REACHABLE, UNKNOWN, UNREACHABLE, Trajectory, select_keyframes
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule, label_trajectory
from ltvn_core.types import Pose
from tests.core.network.training_data.box_world import two_rooms
from tests.core.network.training_data.example_drive import observations_at, poses_along, poses_turning

RULE = OdometryLabelRule(horizon=12)
TOUR = poses_along((1.0, 1.0), (3.2, 1.0), (3.2, 3.3), (6.5, 3.3), (6.5, 1.0), (5.0, 1.0))


def drive(poses: Pose, odometry: Pose | None = None) -> Trajectory:
    return select_keyframes(observations_at(poses, odometry), "drive.rrd")


def near(seen: Trajectory, source: int, target: int, rule: OdometryLabelRule = RULE) -> int:
    return int(rule.labels(seen, np.array([source]), np.array([target]), np.random.default_rng(0))[0])


def far(seen: Trajectory, source: int, target: int) -> bool:
    return bool(RULE.far(seen, np.array([source]), np.array([target]))[0])


def test_what_lies_ahead_is_reachable_and_what_lies_behind_is_not() -> None:
    seen = drive(TOUR)
    assert near(seen, 0, 6) == REACHABLE
    assert near(seen, 6, 0) == UNREACHABLE


def test_half_a_turn_on_the_spot_is_reachable_by_the_paper_alone() -> None:
    seen = drive(poses_turning(2.0, 2.0))
    assert near(seen, 0, 12) == UNREACHABLE
    assert near(seen, 0, 12, OdometryLabelRule(horizon=12, gated=False)) == REACHABLE
    assert near(seen, 0, 2) == REACHABLE


def test_labels_agree_with_those_of_the_simulator_that_knows_the_map() -> None:
    seen = drive(TOUR)
    pairs = label_trajectory(seen, RULE, np.random.default_rng(0))
    depth = seen.depth_mm / np.float32(1000)
    i, j, reachable = (each[::5] for each in (pairs.sources, pairs.targets, pairs.reachable))
    known = label_poses(
        seen.poses[i], seen.poses[j], depth[i], depth[j], two_rooms().floor, limits=ReachabilityLimits()
    )
    assert known.reachable[reachable].mean() > 0.95
    assert known.reachable[~reachable].mean() < 0.02


def test_a_loop_closure_is_neither_reachable_nor_not() -> None:
    loop = poses_along((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0), (1.0, 1.0), (2.0, 1.0))
    seen = drive(loop)
    last = len(seen.poses) - 1
    assert np.hypot(*(seen.poses[last] - seen.poses[8])[:2]) < 0.1
    assert not far(seen, 8, last)
    pairs = label_trajectory(seen, RULE, np.random.default_rng(0))
    assert np.abs(pairs.targets - pairs.sources).max() <= RULE.horizon
    assert not pairs.far(np.array([8]), np.array([last])).any()


def test_the_farther_the_robot_drove_the_farther_apart_images_must_be() -> None:
    straight = drive(poses_along((0.5, 3.3), (4.2, 3.3)))
    last = len(straight.poses) - 1
    assert far(straight, 0, last)
    detour = poses_along((0.5, 3.3), *[(3.0, 3.3), (0.5, 3.3)] * 6, (4.2, 3.3))
    wandered = drive(detour)
    assert not far(wandered, 0, len(wandered.poses) - 1)
    assert far(wandered, len(wandered.poses) - 31, len(wandered.poses) - 1)


def test_images_turned_away_are_far_until_drift_could_explain_it() -> None:
    seen = drive(poses_turning(2.0, 2.0, turns=0.5, step_rad=0.15))
    assert far(seen, 0, len(seen.poses) - 1)
    dizzy = drive(poses_turning(2.0, 2.0, turns=12.5))
    assert not far(dizzy, 0, len(dizzy.poses) - 1)


def test_a_jump_of_odometry_splits_the_drive_and_nothing_is_known_across_it() -> None:
    odometry = TOUR.copy()
    odometry[30:] += [5.0, 0.0, 0.0]
    seen = drive(TOUR, odometry)
    assert seen.pieces == 2
    assert near(seen, 28, 31) == UNKNOWN
    assert not far(seen, 0, 50)
    assert seen.travelled_m[-1] < 15


def test_images_of_one_place_are_thinned() -> None:
    waiting = np.concatenate([TOUR[:1].repeat(30, axis=0), TOUR])
    assert len(drive(waiting).poses) == len(drive(TOUR).poses)


def test_a_drive_that_cannot_teach_is_refused_with_a_reason() -> None:
    still = poses_along((1.0, 1.0), (1.3, 1.0), step_m=0.01)
    with pytest.raises(RecordingError, match=r"drive\.rrd: only 3 of \d+ images"):
        drive(still)
    with pytest.raises(RecordingError, match="holds 5 images; fine-tuning needs 20"):
        drive(TOUR[:5])
    with pytest.raises(RecordingError, match="from odometry, and it does not change"):
        drive(TOUR, np.zeros_like(TOUR))
    missing = TOUR.copy()
    missing[3] = np.nan
    with pytest.raises(RecordingError, match="1 of the poses are missing"):
        drive(TOUR, missing)


def test_exact_poses_make_no_difference() -> None:
    lies = [np.array([9.0, 9.0, 9.0])] * len(TOUR)
    honest = label_trajectory(drive(TOUR), RULE, np.random.default_rng(0))
    deceived = label_trajectory(
        select_keyframes(observations_at(TOUR, exact=lies), "drive.rrd"), RULE, np.random.default_rng(0)
    )
    np.testing.assert_array_equal(honest.sources, deceived.sources)
    np.testing.assert_array_equal(honest.reachable, deceived.reachable)
    np.testing.assert_array_equal(honest.poses, deceived.poses)


def test_images_without_depth_teach_nothing_and_are_said(caplog: pytest.LogCaptureFixture) -> None:
    whole = observations_at(TOUR)
    blind = [replace(seen, depth=np.zeros_like(seen.depth)) if k % 5 == 2 else seen for k, seen in enumerate(whole)]
    kept = select_keyframes(blind, "drive.rrd")
    assert kept.depth_mm.any(axis=(1, 2)).all()
    assert len(kept.poses) < len(select_keyframes(whole, "drive.rrd").poses)
    assert "have no depth" in caplog.text


@pytest.mark.parametrize("depth", [None, np.zeros((72, 96), np.float32)], ids=["absent", "zero"])
def test_a_drive_without_any_depth_is_refused(depth: np.ndarray | None) -> None:
    with pytest.raises(ImageError, match="fine-tuning needs it"):
        select_keyframes([replace(seen, depth=depth) for seen in observations_at(TOUR)], "drive.rrd")
