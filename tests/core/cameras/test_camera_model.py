"""Any camera projects points to pixels and back, and one that cannot be right is refused."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import CameraError, LtvnError
from ltvn_core.robots.robot_spec import LOCOBOT

KINECT = CameraModel(width=640, height=480, fx=517.3, fy=516.5, cx=318.6, cy=255.3, height_m=0.6)
DISTORTIONS = {
    "none": (),
    "k1 k2 p1 p2": (0.26, -0.95, -0.005, 0.0026),
    "with k3": (0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "with k4 k5 k6": (0.1, -0.05, 0.001, -0.002, 0.01, 0.15, -0.04, 0.005),
}


@given(
    ahead_m=st.floats(0.5, 5),
    right=st.floats(-0.4, 0.4),
    down=st.floats(-0.3, 0.3),
    pitch_rad=st.floats(-0.6, 0.6),
    roll_rad=st.floats(-0.5, 0.5),
    quarter_turns=st.integers(0, 3),
    distortion=st.sampled_from(list(DISTORTIONS.values())),
)
def test_a_point_comes_back_from_its_pixel_and_depth(
    ahead_m: float,
    right: float,
    down: float,
    pitch_rad: float,
    roll_rad: float,
    quarter_turns: int,
    distortion: tuple[float, ...],
) -> None:
    camera = replace(KINECT, pitch_rad=pitch_rad, roll_rad=roll_rad, quarter_turns=quarter_turns, distortion=distortion)
    pixel = camera.rays_to_pixels(np.array([right, down]))
    point = camera.unproject(pixel, ahead_m)
    assert camera.project(point) == pytest.approx(pixel, abs=1e-3)
    assert (point - [0, 0, camera.height_m]) @ camera.rotation[:, 0] == pytest.approx(ahead_m)


@pytest.mark.parametrize("distortion", DISTORTIONS.values(), ids=DISTORTIONS.keys())
def test_the_lens_is_the_one_that_opencv_knows(distortion: tuple[float, ...]) -> None:
    camera = replace(KINECT, distortion=distortion)
    rays = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 2))
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    points = np.concatenate([rays, np.ones((50, 1))], axis=1)
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(distortion or (0.0,) * 4))
    assert camera.rays_to_pixels(rays) == pytest.approx(theirs[:, 0], abs=1e-6)


@pytest.mark.parametrize("fisheye", [False, True])
@pytest.mark.parametrize("distortion", [(), (0.02, -0.01, 0.004, -0.001)], ids=["ideal", "distorted"])
def test_no_point_has_no_pixel_and_no_ray(distortion: tuple[float, ...], fisheye: bool) -> None:
    camera = replace(KINECT, fisheye=fisheye, distortion=distortion or (0.0,) * 4 * fisheye)
    nothing = np.zeros((0, 2))
    assert camera.rays_to_pixels(nothing).shape == (0, 2)
    assert camera.unproject(nothing, np.zeros(0)).shape == (0, 3)


def test_a_fisheye_is_the_one_that_opencv_knows_and_can_be_turned_round() -> None:
    camera = replace(KINECT, fx=220.0, fy=221.0, fisheye=True, distortion=(0.02, -0.01, 0.004, -0.001))
    rays = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 2))
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    theirs = cv2.fisheye.distortPoints(rays[:, None], matrix, np.array(camera.distortion))
    assert camera.rays_to_pixels(rays) == pytest.approx(theirs[:, 0], abs=1e-6)
    assert camera.pixels_to_rays(theirs[:, 0].astype(np.float64)) == pytest.approx(rays, abs=1e-6)


def test_what_is_ahead_of_a_level_camera_at_its_own_height_is_in_the_middle() -> None:
    camera = LOCOBOT.camera
    assert camera.project([2.0, 0.0, camera.height_m]) == pytest.approx([(96 - 1) / 2, (72 - 1) / 2])
    left, above = camera.project([2.0, 0.5, camera.height_m]), camera.project([2.0, 0.0, camera.height_m + 0.5])
    assert left[0] < 40
    assert above[1] < 30


def test_a_camera_that_looks_down_sees_a_place_on_the_floor_higher_in_its_picture() -> None:
    place = [2.0, 0.0, 0.0]
    assert replace(LOCOBOT.camera, pitch_rad=-0.2).project(place)[1] < LOCOBOT.camera.project(place)[1]


def test_a_camera_rolled_to_the_right_sees_what_is_on_its_right_higher() -> None:
    place = [2.0, -0.5, 0.6]
    assert replace(LOCOBOT.camera, roll_rad=0.2).project(place)[1] < LOCOBOT.camera.project(place)[1]


def test_what_is_behind_the_camera_has_no_pixel() -> None:
    assert np.isnan(LOCOBOT.camera.project([-1.0, 0.0, 0.6])).all()


def test_quarter_turns_say_how_the_picture_must_be_turned_to_stand_upright() -> None:
    upright = CameraModel.from_fov(40, 60, 0.8)
    turned = replace(CameraModel.from_fov(60, 40, 1.0), fx=upright.fx, fy=upright.fy, quarter_turns=1)
    point = [2.0, 0.3, 0.4]
    picture = np.zeros((40, 60))
    column, row = np.rint(turned.project(point)).astype(int)
    picture[row, column] = 1
    column, row = np.rint(upright.project(point)).astype(int)
    assert np.rot90(picture, turned.quarter_turns)[row, column] == 1


def test_a_scaled_camera_sees_the_same() -> None:
    small = KINECT.scaled(320, 240)
    assert small.horizontal_fov_rad == pytest.approx(KINECT.horizontal_fov_rad)
    assert small.vertical_fov_rad == pytest.approx(KINECT.vertical_fov_rad)
    assert small.project([2, 0.3, 0.4]) + 0.5 == pytest.approx((KINECT.project([2, 0.3, 0.4]) + 0.5) / 2)


def test_a_camera_survives_json_and_the_keys_of_old_recordings_are_read() -> None:
    camera = replace(KINECT, distortion=DISTORTIONS["with k3"], quarter_turns=1, depth_scale=0.001)
    assert CameraModel.from_json(json.loads(json.dumps(camera.to_json()))) == camera
    old = {"width": 96, "height": 72, "horizontal_fov_rad": float(np.deg2rad(69.4)), "height_m": 0.6, "pitch_rad": 0.0}
    assert CameraModel.from_json(old) == LOCOBOT.camera


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 0}, "width and height"),
        ({"height": 72.5}, "width and height"),
        ({"fx": -1.0}, "fx, fy must be positive"),
        ({"cx": float("nan")}, "cx, cy finite"),
        ({"distortion": (0.1, 0.2)}, "0 or 4 or 5 or 8"),
        ({"fisheye": True}, "A fisheye takes 4"),
        ({"pitch_rad": 2.0}, "right angle"),
        ({"quarter_turns": 4}, "0, 1, 2 or 3"),
        ({"depth_scale": 0.0}, "0.001 for millimetres"),
        ({"width": 10**30}, "width and height"),
        ({"width": True}, "width and height"),
        ({"fx": 10**400}, "fx, fy"),
        ({"fx": "wide"}, "fx, fy"),
        ({"cx": [1, 2]}, "cx, cy"),
        ({"height_m": None}, "height must be finite"),
        ({"depth_scale": 10**400}, "metres per unit"),
        ({"distortion": ((1, 2), 3, 4, 5)}, "0 or 4 or 5 or 8"),
    ],
)
def test_a_camera_that_cannot_be_right_is_refused_with_what_would_be(change: dict[str, object], said: str) -> None:
    with pytest.raises(CameraError, match=said) as refused:
        replace(KINECT, **change)
    assert isinstance(refused.value, LtvnError)


def test_the_field_of_view_is_what_a_distorted_lens_sees() -> None:
    fisheye = CameraModel(
        width=160, height=120, fx=80.0, fy=80.0, cx=79.5, cy=59.5, fisheye=True, distortion=(0.0, 0.0, 0.0, 0.0)
    )
    assert fisheye.horizontal_fov_rad == pytest.approx(2.0)
    assert fisheye.vertical_fov_rad == pytest.approx(1.5)
    assert replace(fisheye, fx=40.0).horizontal_fov_rad == pytest.approx(np.pi)
