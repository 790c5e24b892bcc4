"""A drive adapts the geometric predictor's calibration only where that is better, and only as far as pairs tell."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import WeightsError
from ltvn_core.predictors.geometric import GeometricPredictor, SurePose
from ltvn_core.predictors.geometric_adaptation import Comparisons, OwnPairs, Rescaled, adapt, logistic
from ltvn_core.predictors.geometric_evidence import (
    DEPTHS,
    NO_EVIDENCE,
    Calibration,
    Evidence,
    read_calibration,
    shipped_calibration,
)
from ltvn_core.predictors.geometric_features import image_grid
from ltvn_core.predictors.geometric_pose import ROOM_DEPTH_M
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.systems.registry import system_entry
from ltvn_core.training.calibration_tuning import DrivePairs, FoundPose
from ltvn_core.training.drive_path import drive_path
from ltvn_core.types import Observation

IMAGES = 40
BOTH = DEPTHS.index("both")
SHARE = Evidence._fields.index("agreeing_share")


def parent(bias: float) -> Calibration:
    """A calibration that looks at one number alone."""
    weights = np.zeros(len(Evidence._fields))
    weights[SHARE] = 4.0
    return Calibration(dict.fromkeys(DEPTHS, logistic(weights, bias)))


def own_pairs(near_share: float, far_share: float, count: int = 300) -> OwnPairs:
    """Near pairs with right poses and far ones with wrong poses, each with so large a share of agreeing key points."""
    rng = np.random.default_rng(1)
    near = np.arange(count) % 2 == 0
    evidence = np.zeros((count, len(Evidence._fields)))
    evidence[:, SHARE] = np.where(near, near_share, far_share) + rng.normal(0, 0.02, count)
    source = rng.integers(0, IMAGES, count)
    return OwnPairs(
        source=source,
        target=np.clip(source + 1, 0, IMAGES - 1),
        images=IMAGES,
        near=near,
        far=~near,
        known=np.ones(count, bool),
        right=near,
        depths=np.full(count, BOTH),
        found=np.ones(count, bool),
        evidence=evidence,
        share=np.ones(count),
        far_pairs=10 * count,
    )


def shipped(wrong_share: float) -> Mapping[str, Comparisons]:
    """What the package's calibration was fitted on: right poses with much that agrees, wrong ones with little."""
    pairs = own_pairs(0.9, wrong_share, 200)
    found = Comparisons(pairs.evidence, pairs.right, np.ones(200))
    nothing = Comparisons(np.zeros((0, len(Evidence._fields))), np.zeros(0, bool), np.zeros(0))
    return {name: found if name == "both" else nothing for name in DEPTHS}


def test_right_poses_of_which_the_parent_was_not_sure_are_accepted_after_learning() -> None:
    found = adapt(own_pairs(0.6, 0.1), parent(-2.0), shipped(0.1))
    assert found.before.near_recall < 0.05
    assert found.after.near_recall > 0.95
    assert found.after.far_fpr == 0
    assert found.calibration.logistics["both"] != parent(-2.0).logistics["both"]
    assert found.calibration.logistics["none"] == parent(-2.0).logistics["none"], "nothing was seen of these"


def test_nothing_changes_where_it_would_let_wrong_poses_of_the_package_through() -> None:
    before = parent(-2.0)
    found = adapt(own_pairs(0.6, 0.1), before, shipped(0.7))
    assert found.calibration.logistics == before.logistics
    assert found.after == found.before


def test_neither_gets_worse_where_near_and_far_pairs_look_the_same() -> None:
    before = parent(-1.5)
    found = adapt(own_pairs(0.7, 0.7), before, shipped(0.1))
    assert found.after.far_fpr <= found.before.far_fpr
    assert found.after.near_recall >= found.before.near_recall


def test_a_drive_with_few_right_poses_changes_nothing() -> None:
    found = adapt(own_pairs(0.6, 0.1, 30), parent(-2.0), shipped(0.1))
    assert found.calibration.logistics == parent(-2.0).logistics


def test_a_parent_that_takes_far_for_near_is_adapted_to_do_so_less() -> None:
    found = adapt(own_pairs(0.9, 0.6), parent(-0.5), shipped(0.1))
    assert found.before.far_fpr > 1e-3
    assert found.after.far_fpr <= 1e-3
    assert found.after.near_recall >= found.before.near_recall


def test_another_guess_of_distances_is_taken_unless_it_makes_things_worse() -> None:
    pairs = own_pairs(0.9, 0.1)
    better, worse = (Rescaled(replace(pairs, share=np.full(300, share)), depth) for share, depth in ((1, 1.1), (0, 9)))
    assert adapt(pairs, parent(-1.0), shipped(0.1), better).calibration.room_depth_m == 1.1
    assert adapt(pairs, parent(-1.0), shipped(0.1), worse).calibration.room_depth_m == parent(-1.0).room_depth_m


def test_a_drive_without_depth_teaches_how_far_away_things_are() -> None:
    camera = CameraModel.from_fov(32, 24, 1.0)
    line = [np.array([0.2 * k, 0.0, 0.0]) for k in range(24)]
    seen = [
        Observation(rgb=np.zeros((24, 32, 3), np.uint8), depth=None, odometry=pose, stamp=float(k), step=k)
        for k, pose in enumerate(line)
    ]
    predictor = GeometricPredictor(camera)
    source, target = np.arange(20), np.arange(1, 21)
    guessed = FoundPose(NO_EVIDENCE, SurePose(0.0, np.array([0.5, 0.02, 0.0]), 0.5, 0.0))
    pairs = DrivePairs(
        path=drive_path(seen, "line", camera),
        features=[row[0] for row in predictor.encode(seen)],
        predictor=predictor,
        grid=image_grid(camera),
        source=source,
        target=target,
        found=[guessed] * 20,
        far_pairs=0,
    )
    rescaled = pairs.rescaled()
    assert rescaled is not None
    assert rescaled.room_depth_m == pytest.approx(ROOM_DEPTH_M * 0.4, rel=0.01)
    assert rescaled.pairs.right.all()
    assert replace(pairs, found=[None] * 20).rescaled() is None


def test_a_calibration_is_read_back_as_it_was_written_and_names_itself(tmp_path: Path) -> None:
    written = replace(parent(-1.0), room_depth_m=1.4, card={"command": "ltvn finetune"})
    path = tmp_path / "own.json"
    path.write_text(written.text(), encoding="utf-8")
    assert read_calibration(path) == written
    opened = [
        open_predictor("geometric", weights=weights, camera=LOCOBOT.camera).fingerprint for weights in (path, None)
    ]
    assert opened[0] != opened[1]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda held: [],
        lambda held: {},
        lambda held: held | {"room_depth_m": -1},
        lambda held: held | {"card": 3},
        lambda held: held | {"logistics": {"both": held["logistics"]["both"]}},
        lambda held: held | {"logistics": {"both": {"weights": {"agreeing": 1.0}, "bias": 0.0}}},
        lambda held: held | {"logistics": dict.fromkeys(DEPTHS, held["logistics"]["both"] | {"bias": "0"})},
        lambda held: held | {"logistics": dict.fromkeys(DEPTHS, held["logistics"]["both"] | {"bias": float("nan")})},
    ],
)
def test_what_is_no_calibration_is_refused_with_the_command_that_makes_one(tmp_path: Path, spoil: object) -> None:
    path = tmp_path / "own.json"
    path.write_text(json.dumps(spoil(json.loads(shipped_calibration().text()))), encoding="utf-8")  # type: ignore[operator]
    with pytest.raises(WeightsError, match=r"--predictor geometric --output NAME\.json"):
        open_predictor("geometric", weights=path)


def test_a_missing_calibration_is_named(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"nowhere\.json"):
        open_predictor("geometric", weights=tmp_path / "nowhere.json")


def test_weights_of_the_network_do_not_reach_the_geometric_predictor() -> None:
    entry = system_entry("ltvn")
    assert entry.weights_for("network") == entry.weights
    assert entry.weights_for("geometric") is None
    assert entry.weights_for("geometric", Path("own.json")) == Path("own.json")
    assert open_predictor("geometric", weights=entry.weights).fingerprint == open_predictor("geometric").fingerprint
