"""Every usual encoding of ROS's images gives the same colours and depth, and every usual lens is understood."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, bag, colours, jpeg, metres, png
from tests.core.data.importing.rvl_encoder import encode_rvl

SMOOTH = colours(3)
COLOURS, DEPTH = "/camera/color/image_raw", "/camera/depth/image_raw"


def bayer(pixels: NDArray[np.uint8], letters: str) -> NDArray[np.uint8]:
    """Keep one colour of each pixel, in the pattern of two lines that ROS spells."""
    mosaic = np.zeros(pixels.shape[:2], np.uint8)
    for place, letter in enumerate(letters):
        row, column = divmod(place, 2)
        mosaic[row::2, column::2] = pixels[row::2, column::2, "rgb".index(letter)]
    return mosaic


def padded(pixels: NDArray) -> NDArray:
    """Return the same pixels with unused bytes behind each line, as many drivers align them."""
    wide = np.zeros((pixels.shape[0], pixels.shape[1] + 8, *pixels.shape[2:]), pixels.dtype)
    wide[:, : pixels.shape[1]] = pixels
    return wide


def only_frame(path: Path) -> RawFrame:
    return next(RosbagReader.open(path, ReadOptions()).frames())


@pytest.mark.parametrize(
    ("encoding", "pixels", "tolerance"),
    [
        ("rgb8", SMOOTH, 0),
        ("bgr8", SMOOTH[..., ::-1], 0),
        ("rgba8", cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2RGBA), 0),
        ("bgra8", cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2BGRA), 0),
        ("8UC3", SMOOTH[..., ::-1], 0),
        ("rgb16", SMOOTH.astype(np.uint16) * 256, 0),
        ("bayer_rggb8", bayer(SMOOTH, "rggb"), 8),
        ("bayer_bggr8", bayer(SMOOTH, "bggr"), 8),
        ("bayer_gbrg8", bayer(SMOOTH, "gbrg"), 8),
        ("bayer_grbg8", bayer(SMOOTH, "grbg"), 8),
        ("yuv422", cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_UYVY), 12),
        ("yuv422_yuy2", cv2.cvtColor(SMOOTH, cv2.COLOR_RGB2YUV_YUY2), 12),
    ],
)
def test_colours_of_each_encoding(tmp_path: Path, encoding: str, pixels: NDArray, tolerance: int) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.image(COLOURS, np.ascontiguousarray(pixels), encoding, BEGIN_S)

    found = only_frame(tmp_path / "drive").rgb

    assert found.shape == SMOOTH.shape
    assert np.abs(found[2:-2, 2:-2].astype(int) - SMOOTH[2:-2, 2:-2]).max() <= tolerance


def test_grey_images_become_grey_colours(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.image("/camera/image_raw", np.full((48, 64), 77, np.uint8), "mono8", BEGIN_S)

    assert (only_frame(tmp_path / "drive").rgb == 77).all()


def test_lines_may_be_padded_and_compressed_images_decode(tmp_path: Path) -> None:
    wide = padded(SMOOTH)
    with bag(tmp_path / "padded") as builder:
        message = builder.make(
            "sensor_msgs/msg/Image",
            header=builder.header(BEGIN_S, "camera"),
            height=48,
            width=64,
            encoding="rgb8",
            is_bigendian=0,
            step=wide.strides[0],
            data=wide.ravel(),
        )
        builder.write(COLOURS, message, BEGIN_S)
    with bag(tmp_path / "jpeg") as builder:
        builder.compressed(f"{COLOURS}/compressed", jpeg(SMOOTH), "rgb8; jpeg compressed bgr8", BEGIN_S)

    assert np.array_equal(only_frame(tmp_path / "padded").rgb, SMOOTH)
    assert np.abs(only_frame(tmp_path / "jpeg").rgb.astype(int) - SMOOTH).mean() < 2


def compressed_depth(depth: NDArray[np.uint16], scale: float = 0.0, offset: float = 0.0) -> bytes:
    return struct.pack("<iff", 0, scale, offset) + png(depth)


MILLIMETRES = (metres(4) * 1000).astype(np.uint16)
INVERSE = np.round(100.0 / metres(4) + 7.0).astype(np.uint16)


@pytest.mark.parametrize(
    ("form", "content"),
    [
        ("16UC1", MILLIMETRES),
        ("32FC1", np.where(np.eye(48, 64) > 0, np.nan, metres(4)).astype(np.float32)),
        ("16UC1; compressedDepth png", compressed_depth(MILLIMETRES)),
        ("16UC1; compressedDepth rvl", struct.pack("<iffII", 0, 0, 0, 64, 48) + encode_rvl(MILLIMETRES)),
        ("32FC1; compressedDepth png", compressed_depth(INVERSE, 100.0, 7.0)),
        ("16UC1; png compressed ", png(MILLIMETRES)),
    ],
)
def test_depth_of_each_form_is_metres(tmp_path: Path, form: str, content: Any) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.image(COLOURS, SMOOTH, "rgb8", BEGIN_S)
        if isinstance(content, bytes):
            builder.compressed(f"{DEPTH}/compressedDepth", content, form, BEGIN_S)
        else:
            builder.image(DEPTH, content, form, BEGIN_S)

    depth = only_frame(tmp_path / "drive").depth_m

    assert depth is not None
    assert np.isfinite(depth).all()
    assert np.allclose(depth[depth > 0], 1.5, atol=0.02)
    assert (depth > 0).mean() > 0.95


@pytest.mark.parametrize(
    ("model", "coefficients", "fisheye", "expected"),
    [
        ("plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.05), False, (0.1, -0.2, 0.001, 0.002, 0.05)),
        ("plumb_bob", (0.0,) * 5, False, ()),
        ("rational_polynomial", (0.1, 0.2, 0, 0, 0.3, 0.4, 0.5, 0.6), False, (0.1, 0.2, 0, 0, 0.3, 0.4, 0.5, 0.6)),
        ("equidistant", (0.1, 0.01, 0.0, 0.0), True, (0.1, 0.01, 0.0, 0.0)),
    ],
)
def test_the_lens_of_each_model(
    tmp_path: Path, model: str, coefficients: tuple[float, ...], fisheye: bool, expected: tuple[float, ...]
) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.camera_info("/camera/color/camera_info", BEGIN_S, model=model, d=coefficients)
        builder.image(COLOURS, SMOOTH, "rgb8", BEGIN_S)
        builder.image("/camera/color/image_rect", SMOOTH, "rgb8", BEGIN_S)

    raw = next(RosbagReader.open(tmp_path / "drive", ReadOptions(rgb=COLOURS)).frames()).camera
    rectified = only_frame(tmp_path / "drive").camera

    assert raw is not None
    assert (raw.fisheye, raw.distortion) == (fisheye, expected)
    assert rectified is not None
    assert (rectified.fisheye, rectified.distortion, rectified.fx) == (False, (), 55.0)


def test_zeros_for_a_calibration_are_no_camera(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.camera_info("/camera/color/camera_info", BEGIN_S, focal=0.0)
        builder.image(COLOURS, SMOOTH, "rgb8", BEGIN_S)

    assert only_frame(tmp_path / "drive").camera is None
