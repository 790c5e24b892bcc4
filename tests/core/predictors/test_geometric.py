"""The geometric predictor: what it measures, when it is sure, and the contract that every predictor keeps."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import PAPER, ROBUST
from ltvn_core.errors import ImageError
from ltvn_core.geometry import distance, relative
from ltvn_core.predictors.geometric import GeometricPredictor
from ltvn_core.predictors.geometric_pose import epipolar_motion
from ltvn_core.predictors.opening import open_method
from ltvn_core.types import Observation, Predictor, Tilt
from tests.core.predictors.textured_room import CAMERA, TexturedRoom, without_depth

HERE = np.array([1.2, 2.0, 0.1])
AHEAD = np.array([1.7, 2.15, -0.05])
BEHIND = np.array([3.5, 2.0, 3.0])


@pytest.fixture(scope="module")
def room() -> TexturedRoom:
    return TexturedRoom(3)


@pytest.fixture(scope="module")
def predictor() -> GeometricPredictor:
    return GeometricPredictor(CAMERA)


def moved(step: list[float]) -> np.ndarray:
    return HERE + np.array(step)


def asked(predictor: Predictor, source: Observation, target: Observation) -> tuple[float, np.ndarray]:
    found = predictor.predict(predictor.encode([source]), predictor.encode([target]))
    return float(found.reachability[0]), found.waypoints[0]


def test_a_near_place_is_reachable_and_its_waypoint_right_to_centimetres(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    reachability, waypoint = asked(predictor, room.observe(HERE), room.observe(AHEAD))
    assert reachability > 0.8
    np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.03)


@pytest.mark.parametrize(
    "lens",
    [
        replace(CAMERA, fx=140.0, fy=140.0, fisheye=True, distortion=(0.02, -0.01, 0.0, 0.0)),
        replace(CAMERA, width=160, height=120, fx=62.0, fy=62.0, cx=79.5, cy=59.5, fisheye=True, distortion=(0.0,) * 4),
        CameraModel.from_fov(160, 120, np.deg2rad(110), height_m=0.6),
    ],
    ids=["fisheye", "small fisheye", "small and wide"],
)
def test_images_of_a_wide_lens_are_compared_as_it_took_them(room: TexturedRoom, lens: CameraModel) -> None:
    predictor = GeometricPredictor(lens)
    source, target = room.observe(HERE, camera=lens), room.observe(AHEAD, camera=lens)
    reachability, waypoint = asked(predictor, source, target)
    assert reachability > 0.8
    np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.06)
    reachability, guessed = asked(predictor, without_depth(source), without_depth(target))
    assert reachability > 0.8
    assert guessed[2] == pytest.approx(waypoint[2], abs=0.05)


def test_the_other_direction_and_another_room_are_not_reachable(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    assert asked(predictor, room.observe(HERE), room.observe(BEHIND))[0] < 0.1
    assert asked(predictor, room.observe(HERE), TexturedRoom(4).observe(HERE))[0] < 0.1


def test_what_lies_behind_is_measured_and_reached_the_other_way(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    reachability, waypoint = asked(predictor, room.observe(AHEAD), room.observe(HERE))
    assert reachability < 0.3
    np.testing.assert_allclose(waypoint, relative(AHEAD, HERE), atol=0.03)


def test_a_thing_in_the_straight_way_makes_a_place_unreachable(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    seen, target = room.observe(HERE), room.observe(moved([0.9, 0.1, 0.0]))
    blocked = seen.require_depth("the test").copy()
    blocked[60:200, 140:180] = 0.5
    assert asked(predictor, seen, target)[0] > 0.8
    reachability, waypoint = asked(predictor, replace(seen, depth=blocked), target)
    assert reachability < 0.4
    assert distance(relative(relative(HERE, moved([0.9, 0.1, 0.0])), waypoint)) < 0.1


def test_depth_in_one_of_two_images_is_enough(predictor: GeometricPredictor, room: TexturedRoom) -> None:
    source, target = room.observe(HERE), room.observe(AHEAD)
    for first, second in ((source, without_depth(target)), (without_depth(source), target)):
        reachability, waypoint = asked(predictor, first, second)
        assert reachability > 0.6
        np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.04)


def test_without_any_depth_the_turn_and_the_direction_are_right_and_the_distance_is_a_guess(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    target = np.array([1.75, 2.1, -0.1])
    source, seen = without_depth(room.observe(HERE)), without_depth(room.observe(target))
    reachability, waypoint = asked(predictor, source, seen)
    true = relative(HERE, target)
    assert reachability > 0.5
    assert waypoint[2] == pytest.approx(true[2], abs=0.03)
    assert np.arctan2(waypoint[1], waypoint[0]) == pytest.approx(np.arctan2(true[1], true[0]), abs=0.15)
    assert 0.4 < np.hypot(*waypoint[:2]) / np.hypot(*true[:2]) < 2.5
    assert asked(predictor, source, without_depth(TexturedRoom(4).observe(HERE)))[0] < 0.1


def test_without_any_depth_a_turn_on_the_spot_is_no_way(predictor: GeometricPredictor, room: TexturedRoom) -> None:
    turned = without_depth(room.observe(moved([0.0, 0.0, 0.2])))
    reachability, waypoint = asked(predictor, without_depth(room.observe(HERE)), turned)
    assert reachability > 0.5
    np.testing.assert_allclose(waypoint, [0, 0, 0.2], atol=0.02)


def test_a_camera_that_is_held_by_hand_is_levelled_by_the_tilt_of_each_image(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    tilts = Tilt(pitch_rad=-0.25, roll_rad=0.15), Tilt(pitch_rad=0.1, roll_rad=-0.1)
    seen = [
        replace(room.observe(pose, camera=replace(CAMERA, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad)), tilt=tilt)
        for pose, tilt in zip((HERE, AHEAD), tilts, strict=True)
    ]
    reachability, waypoint = asked(predictor, seen[0], seen[1])
    assert reachability > 0.6
    np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.04)


def faint(seen: Observation, contrast: float) -> Observation:
    """Return an image of little contrast, with the noise of a camera."""
    noise = np.random.default_rng(seen.step).normal(0, 0.5, seen.rgb.shape)
    rgb = 128 + (seen.rgb - 128.0) * contrast + noise
    return replace(seen, rgb=np.rint(rgb).clip(0, 255).astype(np.uint8))


@pytest.mark.parametrize("contrast", [0.05, 0.08])
def test_places_of_little_contrast_are_recognised_and_others_of_as_little_are_not(
    predictor: GeometricPredictor, room: TexturedRoom, contrast: float
) -> None:
    source = faint(room.observe(HERE, 1), contrast)
    reachability, waypoint = asked(predictor, source, faint(room.observe(AHEAD, 2), contrast))
    assert reachability > 0.8
    np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.05)
    for other in (room.observe(BEHIND, 3), TexturedRoom(4).observe(HERE, 4), TexturedRoom(5).observe(HERE, 5)):
        assert asked(predictor, source, faint(other, contrast))[0] < 0.1
    assert predictor.key_point_counts(predictor.encode([source]))[0] < 100, "faint key points count as few"


def test_a_blank_image_resembles_nothing_not_even_itself(predictor: GeometricPredictor, room: TexturedRoom) -> None:
    seen = room.observe(HERE)
    blank = replace(seen, rgb=np.full_like(seen.rgb, 90))
    for source, target in ((blank, blank), (blank, seen), (seen, without_depth(blank))):
        reachability, waypoint = asked(predictor, source, target)
        assert reachability < 0.1
        assert np.isfinite(waypoint).all()


@pytest.mark.parametrize(
    "camera",
    [
        CameraModel.from_fov(320, 240, np.deg2rad(90), height_m=0.4, pitch_rad=np.deg2rad(-25)),
        CameraModel.from_fov(160, 120, np.deg2rad(57), height_m=1.1),
        CameraModel(width=240, height=320, fx=230, fy=235, cx=117, cy=165, roll_rad=0.2, height_m=0.8),
        replace(CAMERA, distortion=(0.1, -0.15, 0.001, 0.0)),
    ],
)
def test_any_lens_measures_the_same_way(room: TexturedRoom, camera: CameraModel) -> None:
    predictor = GeometricPredictor(camera)
    assert predictor.camera == camera
    reachability, waypoint = asked(predictor, room.observe(HERE, camera=camera), room.observe(AHEAD, camera=camera))
    assert reachability > 0.7
    np.testing.assert_allclose(waypoint, relative(HERE, AHEAD), atol=0.05)


def test_the_same_images_give_the_same_answer_however_they_are_asked(room: TexturedRoom) -> None:
    images = [room.observe(moved([0.1 * k, 0.02 * k, 0.05 * k]), k) for k in range(4)]
    first, second = GeometricPredictor(CAMERA), GeometricPredictor(CAMERA)
    features, again = first.encode(images), np.concatenate([second.encode([each]) for each in images])
    assert features.shape == (4, 1)
    assert first.fingerprint == second.fingerprint
    single = first.predict(features[:1], features)
    pairs = second.predict(np.repeat(again[:1], 4, axis=0), again)
    np.testing.assert_array_equal(single.reachability, pairs.reachability)
    np.testing.assert_array_equal(single.waypoints, pairs.waypoints)


def test_several_threads_and_other_processes_get_the_same_answers(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    images = [room.observe(moved([0.1 * k, 0.0, 0.1 * k]), k) for k in range(4)]
    features = predictor.encode(images)
    with ThreadPoolExecutor(4) as threads:
        encoded = list(threads.map(lambda each: predictor.encode([each]), images))
    carried = pickle.loads(pickle.dumps(np.concatenate(encoded)))
    expected = predictor.predict(features, features[::-1])
    found = GeometricPredictor(CAMERA).predict(carried, carried[::-1])
    np.testing.assert_array_equal(found.reachability, expected.reachability)
    np.testing.assert_array_equal(found.waypoints, expected.waypoints)


def test_among_many_images_the_right_one_is_compared_in_full(room: TexturedRoom) -> None:
    small = CAMERA.scaled(160, 120)
    predictor = GeometricPredictor(small)
    other_room = TexturedRoom(5)
    elsewhere = [moved([0.1 * (k % 5), 0.0, 0.5 * k]) for k in range(30)]
    images = [room.observe(AHEAD, 0, small), *(other_room.observe(pose, 1, small) for pose in elsewhere)]
    others = predictor.encode(images)
    found = predictor.predict(predictor.encode([room.observe(HERE, 99, small)]), others)
    assert found.reachability.argmax() == 0
    assert found.reachability[0] > 0.8
    skipped = ~found.waypoints.any(axis=1)
    assert skipped.sum() > 15
    assert (found.reachability[skipped] < 0.05).all()


def test_another_camera_has_another_fingerprint() -> None:
    assert GeometricPredictor(CAMERA).fingerprint != GeometricPredictor(replace(CAMERA, height_m=0.3)).fingerprint


def test_an_image_of_another_size_and_foreign_features_are_refused(
    predictor: GeometricPredictor, room: TexturedRoom
) -> None:
    with pytest.raises(ImageError, match="takes"):
        predictor.encode([room.observe(HERE, camera=CAMERA.scaled(160, 120))])
    with pytest.raises(ValueError, match="Features"):
        predictor.predict(np.zeros((1, 7)), np.zeros((2, 7)))


def test_nodes_lie_closer_together_than_it_recognises_most_images(
    predictor: GeometricPredictor,
) -> None:
    assert open_method("robust", predictor).building.merge_distance < ROBUST.building.merge_distance
    assert open_method("paper", predictor).building.merge_distance == PAPER.building.merge_distance, "it is literal"


def test_key_points_of_a_wide_lens_agree_although_they_are_seen_to_whole_pixels_only() -> None:
    rng = np.random.default_rng(0)
    focal_px = 60.0
    places = np.column_stack([rng.uniform(-2, 2, 200), rng.uniform(-1.5, 1.5, 200), rng.uniform(1.5, 4, 200)])
    moved = places - np.array([0.25, 0.0, 0.2])
    first, second = (np.rint(each[:, :2] / each[:, 2:] * focal_px) / focal_px for each in (places, moved))
    found = epipolar_motion(first, second, 1 / focal_px)
    assert found is not None
    assert found.agreeing.mean() > 0.9
    assert found.motion.turned_rad < np.deg2rad(1.5)
