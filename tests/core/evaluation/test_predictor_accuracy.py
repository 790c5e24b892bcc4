"""`ltvn judge` measures what it says: known predictors get the figures that they deserve."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.evaluation.predictor_accuracy.judgement import Judgement, JudgementPlan, judgement_findings
from ltvn_core.evaluation.predictor_accuracy.map_accuracy import JudgedMap, map_accuracy
from ltvn_core.evaluation.predictor_accuracy.pair_accuracy import PairAccuracy, PairCounts, sample_pairs
from ltvn_core.geometry import invert, relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training.drive_path import LIMITS, true_views
from ltvn_core.types import Pose, Predictor
from tests.core.evaluation.judged_drive import (
    ConstantPredictor,
    ShiftedPredictor,
    drive,
    judged,
    knowing_predictor,
    sequence,
)


@pytest.fixture(scope="module")
def known() -> Judgement:
    images = sequence(drive())
    return judged(images, images, knowing_predictor())


def pairs_of(predictor: Predictor, poses: Pose | None = None) -> PairAccuracy:
    images = sequence(drive(), poses)
    found = judged(images, images, predictor).pairs
    assert found is not None
    return found


def test_a_predictor_that_knows_the_world_is_perfect_on_pairs_and_map(known: Judgement) -> None:
    assert known.pairs is not None
    assert known.localisation is not None
    assert known.pairs.auc == 1
    assert known.pairs.far_fpr == 0
    assert known.pairs.near_recall == pytest.approx(1, abs=0.02)
    assert known.pairs.waypoint_median_m == pytest.approx(0, abs=1e-9)
    assert known.pairs.ece == pytest.approx(0.025, abs=0.005)
    assert (known.map.pieces, known.map.true_pieces, known.map.largest_piece_share) == (1, 1, 1)
    assert (known.map.false_edges, known.map.perceptual_aliases) == (0, 0)
    assert (known.localisation.localised_share, known.localisation.wrong_place_share) == (1, 0)


def test_a_long_edge_is_false_only_where_it_leads_elsewhere() -> None:
    images = sequence(drive())
    assert images.views is not None
    first = images.observations[0]
    far = next(
        seen
        for seen, move in zip(images.observations, images.views.moves_to(images.views)[0], strict=True)
        if move[0] > 3
    )
    exact = relative(images.views.poses[0], images.views.poses[images.observations.index(far)])
    nodes = [NodeAdded(node_from_observation(seen), Cause.BUILD) for seen in (first, far)]
    edges = [
        EdgeAdded(Edge(first.step, far.step, pose_row(exact), Belief(0.8, 0.1, 0.1)), Cause.BUILD),
        EdgeAdded(
            Edge(far.step, first.step, pose_row(invert(exact) + np.array([0.0, 1.0, 0.0])), Belief(0.8, 0.1, 0.1)),
            Cause.BUILD,
        ),
    ]
    predictor = knowing_predictor()
    shown = TopologicalMap.of(predictor, ltvn_system(ROBUST), TopologicalGraph([*nodes, *edges]), images.observations)
    built = JudgedMap(
        observations=images.observations,
        features=predictor.encode(images.observations),
        views=images.views,
        map=shown,
        deltas=[*nodes, *edges],
    )
    found = map_accuracy(built, progress=lambda done, total: None)
    assert found.false_edges == 1
    assert found.edge_error_p90_m == pytest.approx(0.9)


def test_an_answer_that_is_always_the_same_tells_nothing_apart() -> None:
    found = pairs_of(ConstantPredictor())
    assert found.auc == 0.5
    assert found.near_recall == found.far_fpr == 1
    assert found.recall_at_far_fpr_1e3 == 0


def test_poses_that_belong_to_other_images_are_noticed() -> None:
    poses = np.array([seen.exact_pose for seen in drive()])
    found = pairs_of(knowing_predictor(), np.random.default_rng(0).permutation(poses))
    assert found.auc is not None
    assert abs(found.auc - 0.5) < 0.1
    assert (found.near_recall or 0) < 0.3


def test_a_waypoint_that_is_off_is_measured_and_so_is_the_place_that_it_gives() -> None:
    images = sequence(drive())
    found = judged(images, images, ShiftedPredictor(0.3))
    assert found.pairs is not None
    assert found.localisation is not None
    assert found.pairs.waypoint_median_m == pytest.approx(0.3)
    assert found.localisation.position_median_m == pytest.approx(0.3)


def test_false_matches_between_far_images_are_counted_where_they_are_made() -> None:
    images = sequence(drive())
    frames = [seen.step for seen in images.observations]
    assert images.views is not None
    poses = images.views.poses
    far = [k for k in range(len(frames)) if LIMITS.far(relative(poses[0], poses[k]))]
    lying = knowing_predictor()
    lying.lies = {(frames[0], frames[k]): np.array([0.2, 0.0, 0.0]) for k in far}
    found = judged(images, images, lying).pairs
    assert found is not None
    assert found.far_fpr is not None
    assert found.far_fpr == pytest.approx(len(far) / found.far_pairs)
    assert found.far_fpr_low is not None
    assert found.far_fpr_high is not None
    assert found.far_fpr_low <= found.far_fpr <= found.far_fpr_high


def test_a_sample_is_of_the_kinds_asked_for_and_all_there_is_where_that_is_little() -> None:
    views = sequence(drive()).views
    assert views is not None
    poses = views.poses
    everything = sample_pairs(views, views, most=PairCounts(10**6, 10**6), rng=np.random.default_rng(0))
    some = sample_pairs(views, views, most=PairCounts(300, 500), rng=np.random.default_rng(0))
    assert (everything.is_near.sum(), (~everything.is_near).sum()) == (everything.near_pairs, everything.far_pairs)
    assert (some.is_near.sum(), (~some.is_near).sum()) == (300, 500)
    assert len({*zip(some.sources, some.targets, strict=True)}) == len(some.sources)
    moves = views.moves_to(views)[some.sources, some.targets]
    assert (LIMITS.near(moves) == some.is_near).all()
    assert (LIMITS.far(moves) == ~some.is_near).all()
    np.testing.assert_allclose(some.waypoints, relative(poses[some.sources], poses[some.targets]))


def test_two_sessions_are_judged_against_each_other() -> None:
    first = drive()
    images = sequence(first)
    later = sequence([replace(seen, step=seen.step + 1) for seen in first[::3]])
    found = judged(later, images, knowing_predictor())
    assert found.pairs is not None
    assert found.localisation is not None
    assert found.pairs.auc == 1
    assert found.map.frames == len(first)
    assert (found.localisation.looks, found.localisation.localised_share) == (len(later.observations), 1)


def test_images_of_a_place_that_the_map_does_not_know_are_not_counted() -> None:
    first = drive()
    elsewhere = [replace(seen, step=seen.step + 1, exact_pose=np.array([20.0, 20.0, 0.0])) for seen in first[:4]]
    mapped = sequence(first)
    judgement = judged(sequence([*first[:2], *elsewhere]), mapped, knowing_predictor())
    found = judgement.localisation
    assert found is not None
    assert (found.looks, found.looks_elsewhere) == (2, 4)
    assert any("4 of 6 images" in str(finding) for finding in judgement_findings(judgement, [mapped]))


def test_a_map_that_knows_little_of_the_images_is_doubted_with_the_share_of_the_figures() -> None:
    first = drive()
    far = [replace(seen, odometry=seen.odometry + 50.0, exact_pose=None) for seen in drive()]
    far = [replace(seen, step=seen.step + 1000, stamp=seen.stamp + 1000.0) for seen in far]
    both = [*first, *(replace(seen, exact_pose=np.array([50.0, 50.0, 0.0]) + k) for k, seen in enumerate(far))]
    images = replace(sequence(both), views=None)
    judgement = judged(images, images, knowing_predictor())
    share = judgement.map.largest_piece_share
    assert share < 0.8
    said = judgement_findings(judgement, [images])
    assert any(f"knows {share:.0%} of its own drive" in str(finding) for finding in said)
    assert any("Likely cause" in str(finding) for finding in said)


def test_without_truth_the_map_is_judged_alone() -> None:
    images = replace(sequence(drive()), views=None)
    found = judged(images, images, knowing_predictor())
    assert found.pairs is None
    assert found.localisation is None
    assert found.map.largest_piece_share == 1
    assert found.map.false_edges is None


def test_the_same_seed_gives_the_same_figures_and_another_leaves_other_images_out(known: Judgement) -> None:
    images = sequence(drive())
    again = judged(images, images, knowing_predictor())
    assert (again.pairs, again.map, again.localisation) == (known.pairs, known.map, known.localisation)
    first = judged(images, images, knowing_predictor(), JudgementPlan(pairs=800, seed=0))
    second = judged(images, images, knowing_predictor(), JudgementPlan(pairs=800, seed=1))
    assert set(first.built.map.graph.nodes) != set(second.built.map.graph.nodes)


def test_a_camera_in_the_hand_that_looks_up_instead_of_down_has_turned() -> None:
    seen = drive()[:2]
    level, down = LOCOBOT.camera, replace(LOCOBOT.camera, pitch_rad=np.radians(-70))
    rolled = replace(LOCOBOT.camera, roll_rad=np.radians(30))
    assert true_views(seen, [level, level]).move(0, 1)[2] == pytest.approx(0)
    assert true_views(seen, [level, down]).move(0, 1)[2] == pytest.approx(np.radians(70))
    assert true_views(seen, [rolled, level]).move(0, 1)[2] == pytest.approx(np.radians(30))
    assert LIMITS.far(true_views(seen, [level, down]).move(0, 1))
    assert not LIMITS.near(true_views(seen, [rolled, level]).move(0, 1))


def test_a_turn_on_the_floor_is_the_same_with_and_without_a_tilt() -> None:
    seen = drive()
    tilted = replace(LOCOBOT.camera, pitch_rad=np.radians(-30))
    moves = true_views(seen, [tilted] * len(seen)).moves_to(true_views(seen, [tilted] * len(seen)))
    poses = np.array([each.exact_pose for each in seen])
    np.testing.assert_allclose(moves[..., 2], np.abs(relative(poses[:, None], poses[None])[..., 2]), atol=1e-6)
