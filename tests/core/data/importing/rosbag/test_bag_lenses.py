"""Lenses as drivers and simulators say them: K empty and P right, defaults that do not fit, none at all."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.data.importing.source_camera import parse_camera
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, FOCAL, HEIGHT, WIDTH, bag, colours, metres

COLOURS, COLOUR_INFO = "/camera/color/image_raw", "/camera/color/camera_info"
DEPTH, DEPTH_INFO = "/camera/stereo/image_raw", "/camera/stereo/camera_info"
RIGHT = parse_camera(f"60,60,{(WIDTH - 1) / 2},{(HEIGHT - 1) / 2},{WIDTH},{HEIGHT}")


def drive(path: Path, colour: dict[str, Any], depth: dict[str, Any]) -> Path:
    with bag(path) as builder:
        builder.camera_info(COLOUR_INFO, BEGIN_S, **colour)
        builder.camera_info(DEPTH_INFO, BEGIN_S, **depth)
        for number in range(2):
            stamp = BEGIN_S + 0.1 * number
            builder.image(COLOURS, colours(number), "rgb8", stamp)
            builder.image(DEPTH, metres(number), "32FC1", stamp)
    return path


def read(path: Path, options: ReadOptions = ReadOptions()) -> tuple[list[RawFrame], DriveReader]:  # noqa: B008
    reader = RosbagReader.open(path, options)
    return list(reader.frames()), reader


def test_where_k_is_empty_the_lens_is_that_of_p(tmp_path: Path) -> None:
    frames, reader = read(
        drive(
            tmp_path / "drive",
            {"has_k": False, "focal": 50.0, "d": (0.3, 0.1, 0, 0, 0)},
            {"has_k": False, "focal": 40.0, "model": "rational_polynomial", "d": (0.0,) * 8},
        )
    )

    camera, depth_camera = frames[0].camera, frames[0].depth_camera
    assert camera is not None
    assert depth_camera is not None
    assert (camera.fx, camera.distortion) == (50.0, ())
    assert (depth_camera.fx, depth_camera.distortion) == (40.0, ())
    assert not reader.dropped
    assert not reader.doubts


@pytest.mark.parametrize(
    "depth",
    [
        {"has_k": False, "has_p": False},
        {"focal": float("nan")},
        {"model": "unheard_of", "d": (0.1, 0, 0, 0, 0)},
        {"size": (HEIGHT, WIDTH)},
        {"centre": (5.0, 5.0)},
    ],
)
def test_a_lens_of_the_depth_that_cannot_be_is_left_open(tmp_path: Path, depth: dict[str, Any]) -> None:
    frames, reader = read(drive(tmp_path / "drive", {}, depth))

    assert len(frames) == 2
    assert all(frame.depth_m is not None and frame.depth_camera is None for frame in frames)
    assert not reader.dropped


@pytest.mark.parametrize(
    "said",
    [
        {"centre": (WIDTH / 4, HEIGHT / 4)},
        {"centre": ((WIDTH - 1) / 2, HEIGHT * 0.75)},
        {"focal": 1.0, "centre": (0.0, 0.0)},
        {"size": (WIDTH // 2, HEIGHT // 2), "centre": (WIDTH / 4, HEIGHT / 4)},
    ],
)
def test_a_lens_that_cannot_be_of_these_images_is_doubted_and_that_advice_works(
    tmp_path: Path, said: dict[str, Any]
) -> None:
    path = drive(tmp_path / "drive", said, said)

    _, reader = read(path)
    frames, corrected = read(path, ReadOptions(camera=RIGHT))

    assert any(COLOUR_INFO in doubt and "--camera" in doubt for doubt in reader.doubts)
    assert frames[0].camera is not None
    assert frames[0].camera.fx == RIGHT.fx
    assert frames[0].depth_camera is None
    assert not corrected.doubts


def test_a_camera_that_a_person_names_is_of_the_depth_too_where_the_bag_says_one_lens_for_both(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive", {}, {})
    other = drive(tmp_path / "other", {}, {"focal": 40.0})

    assert RIGHT.fx != FOCAL
    assert read(path, ReadOptions(camera=RIGHT))[0][0].depth_camera is None
    depth_camera = read(other, ReadOptions(camera=RIGHT))[0][0].depth_camera
    assert depth_camera is not None
    assert depth_camera.fx == 40.0


@pytest.mark.parametrize("centre", [(WIDTH * 0.4, HEIGHT * 0.6), (WIDTH / 2, HEIGHT / 2)])
def test_a_lens_near_the_middle_is_not_doubted(tmp_path: Path, centre: tuple[float, float]) -> None:
    _, reader = read(drive(tmp_path / "drive", {"centre": centre}, {"centre": centre}))

    assert not reader.doubts


def test_smaller_images_than_the_camera_takes_are_not_doubted(tmp_path: Path) -> None:
    whole = {"size": (2 * WIDTH, 2 * HEIGHT), "focal": 2 * FOCAL, "centre": (WIDTH - 0.5, HEIGHT - 0.5)}
    frames, reader = read(drive(tmp_path / "drive", whole, whole))

    assert frames[0].camera is not None
    assert np.isclose(frames[0].camera.fx, FOCAL)
    assert not reader.doubts
