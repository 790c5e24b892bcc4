"""Folders in TUM's layout are read as the benchmark means them, and what is wrong with one is said."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.source_camera import parse_camera
from ltvn_core.data.importing.tum_reader import BENCHMARK_CAMERAS, TUM
from ltvn_core.errors import DriveError
from tests.core.data.importing.drives import EXCERPT, FORWARD, write_tum_folder


def read(folder: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(TUM.open(folder, options or ReadOptions()).frames())


def test_a_real_drive_comes_in_with_depth_poses_tilt_and_lens() -> None:
    frames = read(EXCERPT)
    assert len(frames) == 12
    assert all(0.4 < np.median(f.depth_m[f.depth_m > 0]) < 4 for f in frames if f.depth_m is not None)
    assert all(f.camera is not None and len(f.camera.distortion) == 5 for f in frames)
    pitches = [np.degrees(f.tilt.pitch_rad) for f in frames if f.tilt is not None]
    assert len(pitches) == 12
    assert -60 < min(pitches) < max(pitches) < -10
    turned = np.unwrap([f.truth[2] for f in frames if f.truth is not None])
    assert 30 < np.degrees(np.ptp(turned)) < 70


def test_depth_belongs_to_the_colours_within_half_a_frame(tmp_path: Path) -> None:
    assert all(f.depth_m is not None for f in read(write_tum_folder(tmp_path / "a", depth_delay_s=0.04)))
    assert all(f.depth_m is None for f in read(write_tum_folder(tmp_path / "b", frames=1, depth_delay_s=0.04)))


def test_depth_is_in_metres_and_a_folder_without_depth_is_a_drive_too(tmp_path: Path) -> None:
    frames = read(write_tum_folder(tmp_path / "a"))
    assert all(f.depth_m is not None and (f.depth_m == 2.0).all() for f in frames)
    assert [f.depth_m for f in read(write_tum_folder(tmp_path / "b", depth_delay_s=None))] == [None] * 4
    assert [f.depth_m for f in read(tmp_path / "a", ReadOptions(depth="none"))] == [None] * 4


def test_poses_between_two_samples_are_interpolated_and_none_are_made_up(tmp_path: Path) -> None:
    lines = [f"100.05 0 0 1 {FORWARD}", f"100.15 1 0 1 {FORWARD}"]
    frames = read(write_tum_folder(tmp_path, pose_lines=lines))
    assert frames[1].truth == pytest.approx([0.5, 0, 0])
    assert [f.truth is None for f in frames] == [True, False, True, True]


@pytest.mark.parametrize(("number", "name"), [("1", "rgbd_dataset_freiburg1_xyz"), ("3", "fr3_office")])
def test_the_benchmarks_own_cameras_are_known_by_the_name_of_the_sequence(
    tmp_path: Path, number: str, name: str
) -> None:
    frame = read(write_tum_folder(tmp_path / name, frames=1))[0]
    assert frame.camera == BENCHMARK_CAMERAS[number].scaled(64, 48)


def test_a_camera_that_a_person_gives_wins_and_is_scaled_to_the_images(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "fr1", frames=1)
    camera = read(folder, ReadOptions(camera=parse_camera("600,600,319.5,239.5,640,480")))[0].camera
    assert camera is not None
    assert (camera.width, camera.fx) == (64, 60.0)


def test_a_camera_of_another_aspect_is_not_taken_for_that_of_the_images(tmp_path: Path) -> None:
    reader = TUM.open(write_tum_folder(tmp_path), ReadOptions(camera=parse_camera("600,600,639.5,359.5,1280,720")))
    assert list(reader.frames()) == []
    assert "64 x 48" in reader.doubts[0]


def test_a_world_whose_z_is_not_up_is_turned_and_that_is_said(tmp_path: Path) -> None:
    lines = [f"{100 + k / 10} 0 0 {k} 0 0 0 1" for k in range(4)]  # As SLAM programs write: z is the first view.
    reader = TUM.open(write_tum_folder(tmp_path, pose_lines=lines), ReadOptions())
    frame = list(reader.frames())[2]
    assert frame.truth is not None
    assert np.hypot(*frame.truth[:2]) == pytest.approx(2)
    assert frame.tilt == pytest.approx((0, 0), abs=1e-9)
    assert "-y" in reader.doubts[0]


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("rgb.txt", "", "lists no images"),
        ("rgb.txt", "100.0\n", r"rgb.txt, line 1"),
        ("rgb.txt", "\0\0\0", r"rgb.txt, line 1"),
        ("groundtruth.txt", "100.0 1 2 3 0 0 0 9\n", "quaternion"),
        ("groundtruth.txt", "100.0 1 2 3 0 0 zero 1\n", "row of numbers"),
        ("camera.json", "[1, 2]", "camera.json describes no camera"),
        ("camera.json", json.dumps({"width": 64, "height": 48, "fx": -3, "fy": 1, "cx": 1, "cy": 1}), "positive"),
        ("camera.json", "[" * 100_000, "camera.json"),
    ],
)
def test_a_list_that_cannot_be_right_is_refused_in_one_line(tmp_path: Path, file: str, text: str, message: str) -> None:
    (write_tum_folder(tmp_path) / file).write_text(text, encoding="utf-8")
    with pytest.raises(DriveError, match=message) as refusal:
        read(tmp_path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("listed", ["../secret.png", "/etc/hostname", "rgb/missing.png", "rgb", "rgb.txt"])
def test_a_file_that_is_missing_or_outside_or_no_image_is_left_out_and_counted(tmp_path: Path, listed: str) -> None:
    folder = write_tum_folder(tmp_path / "drive")
    (tmp_path / "secret.png").write_bytes((folder / "rgb/100.00.png").read_bytes())
    with (folder / "rgb.txt").open("a", encoding="utf-8") as file:
        file.write(f"100.9 {listed}\n")
    reader = TUM.open(folder, ReadOptions())
    assert len(list(reader.frames())) == 4
    assert reader.dropped == {"damaged or missing image": 1}
    assert listed in reader.doubts[0]


def test_a_cut_image_is_left_out_and_a_picture_that_unpacks_to_gigabytes_is_never_unpacked(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path)
    whole = (folder / "rgb/100.00.png").read_bytes()
    (folder / "rgb/100.00.png").write_bytes(whole[:200])
    # The header of a PNG of 60,000 x 60,000 pixels, on an otherwise small file.
    import struct
    import zlib

    header = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = whole[:8] + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header)) + whole[33:]
    (folder / "rgb/100.10.png").write_bytes(bomb)
    reader = TUM.open(folder, ReadOptions())
    assert len(list(reader.frames())) == 2
    assert reader.dropped == {"damaged or missing image": 2}


@pytest.mark.parametrize("damage", [b"", b"no image", None])
def test_an_image_whose_depth_cannot_be_read_comes_without_depth_and_that_is_said(
    tmp_path: Path, damage: bytes | None
) -> None:
    folder = write_tum_folder(tmp_path)
    deep = folder / "depth/100.10.png"
    deep.unlink()
    if damage is not None:
        deep.write_bytes(damage)
    reader = TUM.open(folder, ReadOptions())
    assert [frame.depth_m is None for frame in reader.frames()] == [False, True, False, False]
    assert not reader.dropped
    assert any("100.10.png" in doubt and "1 depth" in doubt for doubt in reader.doubts)


def test_a_list_of_images_that_are_all_elsewhere_names_one_of_them(tmp_path: Path) -> None:
    poses = [f"{100 + k / 10} {k} 0 0 0 0 0 1" for k in range(4)]  # Their world is on its side, which is a doubt too.
    folder = write_tum_folder(tmp_path / "drive", pose_lines=poses)
    listed = folder / "rgb.txt"
    listed.write_text(listed.read_text(encoding="utf-8").replace(".png", ".jpg"), encoding="utf-8")
    with pytest.raises(DriveError, match=r"rgb/100\.00\.jpg cannot be read"):
        import_drive(TUM.open(folder, ReadOptions()), tmp_path / "drive.rrd")


def test_a_calibration_as_eth3d_writes_it_names_the_lens(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path, frames=1)
    (folder / "calibration.txt").write_text("55.5 56.5 31.5 23.5\n", encoding="utf-8")
    camera = read(folder)[0].camera
    assert camera is not None
    assert (camera.fx, camera.fy, camera.cx, camera.cy, camera.width) == (55.5, 56.5, 31.5, 23.5, 64)


@pytest.mark.parametrize("pitch_deg", [-70, -40, 0, 30])
def test_a_camera_that_looks_down_steeply_does_not_change_what_is_up(tmp_path: Path, pitch_deg: float) -> None:
    ahead = Rotation.from_quat([float(number) for number in FORWARD.split()])
    turn = (Rotation.from_euler("y", -pitch_deg, degrees=True) * ahead).as_quat()
    lines = [f"{100 + k / 10} {0.2 * k} 1 0.5 {' '.join(map(str, turn))}" for k in range(4)]
    frame = read(write_tum_folder(tmp_path, pose_lines=lines))[1]
    assert frame.truth == pytest.approx([0.2, 1, 0], abs=1e-6)
    assert frame.tilt == pytest.approx((np.radians(pitch_deg), 0), abs=1e-6)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_lists_from_windows_are_read(tmp_path: Path, encoding: str) -> None:
    folder = write_tum_folder(tmp_path)
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        text = (folder / name).read_text(encoding="utf-8").replace("/", "\\").replace("\n", "\r\n")
        (folder / name).write_text(text, encoding=encoding, newline="")
    frames = read(folder)
    assert len(frames) == 4
    assert all(frame.depth_m is not None and frame.truth is not None for frame in frames)


@pytest.mark.parametrize(("unit", "name"), [(10**3, "milli"), (10**6, "micro"), (10**9, "nano")])
def test_stamps_in_parts_of_a_second_are_read_so_and_that_is_said(tmp_path: Path, unit: int, name: str) -> None:
    begin, poses = 1_700_000_000, [f"{1_700_000_000 + k / 10} 0.{k} 1 0.5 {FORWARD}" for k in range(4)]
    folder = write_tum_folder(tmp_path, depth_delay_s=None, pose_lines=poses)
    lines = [f"{begin * unit + k * unit // 10} rgb/{100 + k / 10:.2f}.png" for k in range(4)]
    (folder / "rgb.txt").write_text("\n".join(lines), encoding="utf-8")
    reader = TUM.open(folder, ReadOptions())
    frames = list(reader.frames())
    assert [frame.stamp - begin for frame in frames] == pytest.approx([0, 0.1, 0.2, 0.3], abs=1e-5)
    assert all(frame.truth is not None for frame in frames)
    assert f"{name}seconds" in reader.doubts[0]


def test_lists_of_different_clocks_are_named_with_both_ranges(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path, pose_lines=[f"{k / 10} 0 1 0.5 {FORWARD}" for k in range(4)])
    with pytest.raises(DriveError, match=r"100\.000 to 100\.300 s.*0\.000 to 0\.300 s"):
        import_drive(TUM.open(folder, ReadOptions()), tmp_path / "tour.rrd")


def test_quaternions_with_w_first_are_a_doubt(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path / "fr1", frames=12)
    upright = Rotation.from_quat([float(number) for number in FORWARD.split()])
    lines = []
    for k in range(12):
        x, y, z, w = (Rotation.from_euler("z", 30 * k, degrees=True) * upright).as_quat()
        lines.append(f"{100 + k / 10:.4f} {0.2 * k} 1 0.5 {w} {x} {y} {z}")
    (folder / "groundtruth.txt").write_text("\n".join(lines), encoding="utf-8")
    summary = import_drive(TUM.open(folder, ReadOptions()), tmp_path / "tour.rrd")
    assert any("w first" in doubt for doubt in summary.doubts)


def test_the_unit_of_depth_that_a_person_says_wins(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path)

    depth = read(folder, ReadOptions(depth_unit_m=0.001))[0].depth_m

    assert depth is not None
    assert np.allclose(depth, 10.0)


def test_odometry_of_another_format_is_left_out_unless_a_person_names_it(tmp_path: Path) -> None:
    folder = write_tum_folder(tmp_path)
    (folder / "odometry.txt").write_text("100.0 1 2 3\n", encoding="utf-8")
    reader = TUM.open(folder, ReadOptions())
    assert all(frame.odometry is None and frame.truth is not None for frame in reader.frames())
    assert "odometry.txt" in reader.doubts[0]
    for name in ("odometry.txt", "missing.txt"):
        with pytest.raises(DriveError, match=name):
            TUM.open(folder, ReadOptions(odometry=name))
