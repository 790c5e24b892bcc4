"""Which topics of a bag are colours, depth and lenses, whatever drivers call them; what is not used is named."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions
from ltvn_core.data.importing.raw_frame import DriveReader, RawFrame, ReadOptions
from ltvn_core.data.importing.rosbag_reader import RosbagReader
from ltvn_core.errors import DriveError
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, BagBuilder, bag, colours, jpeg, metres, png

COLOURS = "/camera/color/image_raw"
DEPTH = "/camera/depth/image_raw"


def millimetres(number: int) -> NDArray[np.uint16]:
    return np.round(metres(number) * 1000).astype(np.uint16)


def write_depth(builder: BagBuilder, kind: str, topic: str, number: int) -> None:
    stamp, depth = BEGIN_S + 0.1 * number, millimetres(number)
    grey = np.clip(depth // 16, 0, 255).astype(np.uint8)
    if kind in ("mono16", "16UC1"):
        builder.image(topic, depth, kind, stamp)
    elif kind == "png":
        builder.compressed(f"{topic}/compressed", png(depth), "png", stamp)
    elif kind == "png of 8 bits":
        builder.compressed(f"{topic}/compressed", png(grey), "png", stamp)
    else:
        builder.compressed(f"{topic}/compressed", jpeg(np.stack([grey] * 3, axis=-1)), "jpeg", stamp)


def drive(path: Path, kind: str, depth: str = DEPTH, rgb: str = COLOURS) -> Path:
    with bag(path) as builder:
        builder.camera_info(f"{rgb.rpartition('/')[0]}/camera_info", BEGIN_S)
        for number in range(3):
            builder.image(rgb, colours(number), "rgb8", BEGIN_S + 0.1 * number)
            write_depth(builder, kind, depth, number)
    return path


def read(path: Path, options: ReadOptions = ReadOptions()) -> tuple[list[RawFrame], DriveReader]:  # noqa: B008
    reader = RosbagReader.open(path, options)
    return list(reader.frames()), reader


def doubts_of_import(path: Path, options: ReadOptions = ReadOptions()) -> str:  # noqa: B008
    reader = RosbagReader.open(path, options)
    keep_all = ImportOptions(every_m=0, every_deg=0)
    return " ".join(import_drive(reader, path.with_suffix(".rrd"), keep_all).doubts)


@pytest.mark.parametrize("kind", ["mono16", "16UC1", "png"])
@pytest.mark.parametrize(
    "topic", [DEPTH, "/device_0/sensor_0/Depth_0/image/data", "/camera/aligned_depth_to_color/raw"]
)
def test_sixteen_bits_on_a_topic_that_is_called_depth_are_depth(tmp_path: Path, kind: str, topic: str) -> None:
    frames, _ = read(drive(tmp_path / "drive", kind, topic))

    for number, frame in enumerate(frames):
        assert np.array_equal(frame.rgb, colours(number))
        assert frame.depth_m is not None
        assert np.allclose(frame.depth_m, metres(number), atol=1e-3)


@pytest.mark.parametrize("kind", ["jpeg", "png of 8 bits"])
def test_eight_bits_are_no_depth_and_that_is_said(tmp_path: Path, kind: str) -> None:
    frames, reader = read(drive(tmp_path / "drive", kind))

    assert [frame.depth_m for frame in frames] == [None] * 3
    assert any(DEPTH in doubt and "8 bits" in doubt for doubt in reader.doubts)


def test_a_topic_of_sixteen_bits_that_is_not_used_is_named_and_that_advice_works(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive", "mono16", "/oak/stereo/image_raw", "/oak/rgb/image_raw")

    said = doubts_of_import(path)
    frames, _ = read(path, ReadOptions(depth="/oak/stereo/image_raw"))

    assert "/oak/stereo/image_raw" in said
    assert "--depth" in said
    assert all(frame.depth_m is not None for frame in frames)


def test_without_depth_what_there_is_is_named(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        for number in range(3):
            builder.image(COLOURS, colours(number), "rgb8", BEGIN_S + 0.1 * number)

    assert f"no depth among rgb {COLOURS}" in doubts_of_import(tmp_path / "drive")


def test_a_choice_between_cameras_says_which_could_be_depth_and_that_advice_works(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive", "mono16", "/stereo/image", "/mono/image")

    with pytest.raises(DriveError, match="may be depth for --depth: /stereo/image"):
        read(path)
    frames, _ = read(path, ReadOptions(depth="/stereo/image"))

    assert np.array_equal(frames[0].rgb, colours(0))
    assert frames[0].depth_m is not None


def test_colours_as_the_depth_camera_sees_them_are_colours(tmp_path: Path) -> None:
    frames, reader = read(drive(tmp_path / "drive", "16UC1", DEPTH, "/rgb_to_depth/image_raw"))

    assert np.array_equal(frames[1].rgb, colours(1))
    assert not reader.doubts


@pytest.mark.parametrize(
    ("image", "info"),
    [
        ("/device_0/sensor_1/Color_0/image/data", "/device_0/sensor_1/Color_0/info/camera_info"),
        ("/camera/color/image_raw", "/camera/color/info"),
        ("/camera/color/image_raw", "/camera/color/calibration/camera_info"),
        ("/camera/color/image/data", "/camera/color/camera_info"),
        ("/image_raw", "/camera_info"),
    ],
)
def test_the_lens_is_found_in_or_below_the_namespaces_of_the_images(tmp_path: Path, image: str, info: str) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.camera_info(info, BEGIN_S, focal=77.0)
        builder.camera_info("/other/camera_info", BEGIN_S, focal=33.0)
        builder.image("/other/right/image_raw", colours(0), "rgb8", BEGIN_S)
        builder.image(image, colours(0), "rgb8", BEGIN_S)

    camera = read(tmp_path / "drive", ReadOptions(rgb=image))[0][0].camera

    assert camera is not None
    assert camera.fx == 77.0


def test_the_lens_of_images_beside_is_not_taken(tmp_path: Path) -> None:
    with bag(tmp_path / "drive") as builder:
        for name in ("depth", "left"):
            builder.camera_info(f"/camera/{name}/camera_info", BEGIN_S)
        builder.image("/camera/depth/image_raw", millimetres(0), "16UC1", BEGIN_S)
        builder.image("/camera/left/image_raw", colours(0), "rgb8", BEGIN_S)
        builder.image("/camera/color/image_raw", colours(0), "rgb8", BEGIN_S)

    assert read(tmp_path / "drive", ReadOptions(rgb=COLOURS))[0][0].camera is None


def posed(path: Path, kind: str, *, own_stamps: bool = True) -> Path:
    """Write a bag with poses 0.2 m apart, in a path that grows and is corrected at last, or as AMCL publishes them."""
    with bag(path) as builder:
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        poses: list[object] = []
        for number in range(6):
            stamp = BEGIN_S + 0.1 * number
            builder.image(COLOURS, colours(number), "rgb8", stamp)
            head = builder.header(stamp, "map")
            shift = 1.0 if number < 5 else 0.0
            point = builder.make("geometry_msgs/msg/Point", x=0.2 * number + shift, y=0.0, z=0.0)
            turn = builder.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
            pose = builder.make("geometry_msgs/msg/Pose", position=point, orientation=turn)
            if kind == "amcl":
                sure = builder.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
                builder.write(
                    "/amcl_pose",
                    builder.make("geometry_msgs/msg/PoseWithCovarianceStamped", header=head, pose=sure),
                    stamp,
                )
                continue
            own = head if own_stamps else builder.header(BEGIN_S, "map")
            poses.append(builder.make("geometry_msgs/msg/PoseStamped", header=own, pose=pose))
            if number == 5:
                for each in poses[:-1]:
                    each.pose.position.x -= 1.0  # type: ignore[attr-defined]
            builder.write("/slam/path", builder.make("nav_msgs/msg/Path", header=head, poses=list(poses)), stamp)
    return path


@pytest.mark.parametrize(("kind", "topic"), [("amcl", "/amcl_pose"), ("path", "/slam/path")])
def test_poses_that_are_not_read_are_named_with_their_type(tmp_path: Path, kind: str, topic: str) -> None:
    path = posed(tmp_path / "b", kind)
    said = doubts_of_import(path)
    assert topic in said
    assert "--odometry" in said


def test_a_path_is_odometry_as_it_was_corrected_at_last(tmp_path: Path) -> None:
    path = posed(tmp_path / "b", "path")
    frames, _ = read(path, ReadOptions(odometry="/slam/path"))
    places = [frame.odometry[0] for frame in frames if frame.odometry is not None]
    assert places == pytest.approx([0.2 * number for number in range(6)], abs=1e-6)


def test_a_path_whose_poses_have_no_stamps_of_their_own_is_no_odometry(tmp_path: Path) -> None:
    path = posed(tmp_path / "b", "path", own_stamps=False)
    with pytest.raises(DriveError, match="plan"):
        read(path, ReadOptions(odometry="/slam/path"))


def test_a_topic_of_another_type_is_refused_by_its_type(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match="sensor_msgs/msg/Image"):
        read(posed(tmp_path / "b", "path"), ReadOptions(odometry=COLOURS))
