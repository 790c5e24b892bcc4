"""Formats whose files say everything come in with their images, depth in metres, lens, and poses with z up."""

import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import DriveError

av = pytest.importorskip("av")
WIDTH, HEIGHT, FOCAL, FRAMES = 64, 48, 60.0, 13
CX, CY = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
Y_UP = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
"""Rotation (3, 3) from a world with z up to that of a phone, whose y is up."""
GRAPHICS = np.diag([1.0, -1.0, -1.0, 1.0])


def circle(radius_m: float = 1.0) -> list[tuple[float, float, float]]:
    """Half a circle to the left, as x, y, yaw."""
    angles = np.linspace(0, np.pi, FRAMES)
    return [(radius_m * np.sin(a), radius_m * (1 - np.cos(a)), a) for a in angles]


def optical_pose(x: float, y: float, yaw: float, *, roll: float = 0.0) -> NDArray[np.float64]:
    """The pose of a level optical frame, 1.4 m above the floor, in a world with z up."""
    turn = Rotation.from_euler("z", yaw).as_matrix() @ np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ Rotation.from_euler("z", roll).as_matrix()
    pose[:3, 3] = x, y, 1.4
    return pose


def phone_pose(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    world = np.eye(4)
    world[:3, :3] = Y_UP
    return world @ pose


def picture(k: int) -> NDArray[np.uint8]:
    return np.full((HEIGHT, WIDTH, 3), 15 * k, np.uint8)


def write_depth(path: Path, k: int, *, size: tuple[int, int] = (32, 24)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((size[1], size[0]), 1000 + 100 * k, np.uint16))


def write_stray(folder: Path, *, roll: float = 0.0, taken_out: bool = False) -> Path:
    folder.mkdir(parents=True)
    with av.open(str(folder / "rgb.mp4"), "w") as container:
        stream: Any = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for k in range(FRAMES):
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture(k), "rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    rows = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for k, place in enumerate(circle()):
        pose = phone_pose(optical_pose(*place, roll=roll))
        numbers = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        rows.append(", ".join([f"{500 + k / 10}", f"{k:06d}", *(f"{number:.6f}" for number in numbers)]))
        write_depth(folder / f"depth/{k:06d}.png", k)
        (folder / "confidence").mkdir(exist_ok=True)
        sure = np.full((24, 32), 2, np.uint8)
        sure[:, :8] = 0
        cv2.imwrite(str(folder / f"confidence/{k:06d}.png"), sure)
        if taken_out:
            cv2.imwrite(str(folder / f"{k:06d}.jpg"), picture(k))
    (folder / "odometry.csv").write_text("\n".join(rows), encoding="utf-8")
    (folder / "camera_matrix.csv").write_text(f"{FOCAL}, 0, {CX}\n0, {FOCAL}, {CY}\n0, 0, 1\n", encoding="utf-8")
    if taken_out:
        (folder / "rgb.mp4").unlink()
    return folder


def write_nerfstudio(folder: Path, *, by_colmap: bool = False) -> Path:
    frames = []
    for k, place in enumerate(circle()):
        (folder / "images").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"images/frame_{k}.png"), picture(k))
        write_depth(folder / f"depth/{k}.png", k)
        frame = {
            "file_path": f"./images/frame_{k}.png",
            "depth_file_path": f"depth/{k}.png",
            "transform_matrix": (optical_pose(*place) @ GRAPHICS).tolist(),
        }
        frames.append(frame | ({"colmap_im_id": k} if by_colmap else {}))
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": CX, "cy": CY, "w": WIDTH, "h": HEIGHT, "k1": 0.01}
    said = {"camera_model": "OPENCV", **lens, "frames": frames[::-1]}
    (folder / "transforms.json").write_text(json.dumps(said), encoding="utf-8")
    return folder


def write_record3d(path: Path) -> Path:
    poses = [phone_pose(optical_pose(*place)) @ GRAPHICS for place in circle()]
    rows = [[*Rotation.from_matrix(pose[:3, :3]).as_quat(), *pose[:3, 3]] for pose in poses]
    k = [FOCAL, 0, 0, 0, FOCAL, 0, CX, CY, 1]
    metadata = {"K": k, "w": WIDTH, "h": HEIGHT, "dw": 32, "dh": 24, "fps": 10, "poses": rows}
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("metadata", json.dumps(metadata))
        for k in range(FRAMES):
            archive.writestr(f"rgbd/{k}.jpg", cv2.imencode(".jpg", picture(k))[1].tobytes())
            archive.writestr(f"rgbd/{k}.depth", b"bvx2")
    return path


def write_colmap(folder: Path) -> Path:
    (folder / "images").mkdir(parents=True)
    (folder / "sparse/0").mkdir(parents=True)
    lines = []
    for k in range(FRAMES):
        cv2.imwrite(str(folder / f"images/walk {k}.jpg"), picture(k))
        lines.append(
            f"{k} 1 0 0 0 0 0 0 7 walk {k}.jpg\n1.0 2.0 -1 3.0 4.0 5"
            if k % 2
            else f"{k} 1 0 0 0 0 0 0 7 walk {k}.jpg\n"
        )
    (folder / "sparse/0/images.txt").write_text("# images\n" + "\n".join(lines), encoding="utf-8")
    camera = f"7 SIMPLE_RADIAL {WIDTH} {HEIGHT} {FOCAL} {WIDTH / 2} {HEIGHT / 2} 0.02\n"
    (folder / "sparse/0/cameras.txt").write_text(f"# cameras\n{camera}", encoding="utf-8")
    return folder


WRITERS = {"stray": write_stray, "nerfstudio": write_nerfstudio, "record3d": write_record3d}


def path_of(frames: list[RawFrame]) -> NDArray[np.float64]:
    poses = [frame.odometry if frame.truth is None else frame.truth for frame in frames]
    return np.array([pose for pose in poses if pose is not None])


@pytest.mark.parametrize("kind", WRITERS)
def test_a_drive_comes_in_with_all_its_images_and_its_way(tmp_path: Path, kind: str) -> None:
    reader = open_drive(WRITERS[kind](tmp_path / f"drive{'.r3d' if kind == 'record3d' else ''}"))
    frames = list(reader.frames())
    poses = path_of(frames)
    assert (reader.facts.format, len(frames), reader.facts.frames) == (kind, FRAMES, FRAMES)
    assert [frame.rgb.mean() for frame in frames] == pytest.approx([15 * k for k in range(FRAMES)], abs=4)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() == pytest.approx(np.pi, abs=0.05)
    assert np.unwrap(poses[:, 2])[-1] - poses[0, 2] == pytest.approx(np.pi, abs=1e-3)
    area = 0.5 * np.sum(poses[:-1, 0] * poses[1:, 1] - poses[1:, 0] * poses[:-1, 1])
    assert area == pytest.approx(np.pi / 2, abs=0.05)
    camera = frames[0].camera
    assert camera is not None
    assert (camera.fx, camera.cx, camera.width) == pytest.approx((FOCAL, CX, WIDTH))
    assert all(abs(frame.tilt.roll_rad) + abs(frame.tilt.pitch_rad) < 1e-3 for frame in frames if frame.tilt)


@pytest.mark.parametrize("kind", ["stray", "nerfstudio"])
def test_depth_is_in_metres_in_the_order_of_the_images(tmp_path: Path, kind: str) -> None:
    depths = [frame.depth_m for frame in open_drive(WRITERS[kind](tmp_path / "drive")).frames()]
    assert [float(depth[5, 20]) for depth in depths if depth is not None] == pytest.approx(
        [1 + 0.1 * k for k in range(FRAMES)]
    )


def test_depth_of_low_confidence_is_no_return(tmp_path: Path) -> None:
    depth = next(iter(open_drive(write_stray(tmp_path / "scan")).frames())).depth_m
    assert depth is not None
    assert float(depth[5, 2]) == 0.0


def test_a_scan_whose_images_were_taken_out_of_the_video_is_read(tmp_path: Path) -> None:
    frames = list(open_drive(write_stray(tmp_path / "scan", taken_out=True)).frames())
    assert len(frames) == FRAMES
    assert all(frame.odometry is not None and frame.depth_m is not None for frame in frames)


def test_a_phone_that_was_held_upright_gives_upright_images(tmp_path: Path) -> None:
    reader = open_drive(write_stray(tmp_path / "scan", roll=np.pi / 2))
    summary = import_drive(reader, tmp_path / "scan.rrd", ImportOptions(every_m=0, every_deg=0))
    assert (summary.camera.width, summary.camera.height) == (HEIGHT, WIDTH)
    assert summary.tilt is not None
    assert summary.tilt.roll_largest_deg < 1


def test_packed_depth_is_named_with_the_way_to_unpack_it(tmp_path: Path) -> None:
    summary = import_drive(open_drive(write_record3d(tmp_path / "walk.r3d")), tmp_path / "walk.rrd")
    assert any("LZFSE" in doubt for doubt in summary.doubts)
    assert not any("There is no depth" in doubt for doubt in summary.doubts)


def test_a_damaged_archive_is_refused(tmp_path: Path) -> None:
    path = write_record3d(tmp_path / "walk.r3d")
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(DriveError, match="whole"):
        open_drive(path)


@pytest.mark.parametrize("kind", ["colmap", "nerfstudio"])
def test_poses_without_a_unit_are_not_taken_for_metres(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "scene"
    reader = open_drive(write_colmap(folder) if kind == "colmap" else write_nerfstudio(folder, by_colmap=True))
    frames = list(reader.frames())
    assert len(frames) == FRAMES
    assert all(frame.odometry is None and frame.truth is None for frame in frames)
    assert any("metres" in doubt for doubt in reader.doubts)


def test_the_lens_of_a_colmap_model_is_in_our_pixels(tmp_path: Path) -> None:
    frames = list(open_drive(write_colmap(tmp_path / "scene")).frames())
    camera = frames[0].camera
    assert camera is not None
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((FOCAL, CX, CY))
    assert camera.distortion[0] == pytest.approx(0.02)
    assert [frame.rgb.mean() for frame in frames] == pytest.approx([15 * k for k in range(FRAMES)], abs=4)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera-intrinsics.txt", f"{FOCAL} 0 {CX}\n0 {FOCAL} {CY}\n0 0 1\n"),
        ("camera_matrix.csv", f"{FOCAL}, 0, {CX}\n0, {FOCAL}, {CY}\n0, 0, 1\n"),
        ("intrinsic/intrinsic_color.txt", f"{FOCAL} 0 {CX} 0\n0 {FOCAL} {CY} 0\n0 0 1 0\n0 0 0 1\n"),
        (
            "intrinsic.json",
            json.dumps({"width": WIDTH, "height": HEIGHT, "intrinsic_matrix": [FOCAL, 0, 0, 0, FOCAL, 0, CX, CY, 1]}),
        ),
    ],
)
def test_a_camera_matrix_beside_pictures_is_their_lens(tmp_path: Path, name: str, text: str) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(text, encoding="utf-8")
    camera = next(iter(open_drive(tmp_path).frames())).camera
    assert camera is not None
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((FOCAL, CX, CY))


def test_a_camera_matrix_of_another_image_size_is_not_taken(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
    (tmp_path / "K.txt").write_text("600 0 320\n0 600 240\n0 0 1\n", encoding="utf-8")
    reader = open_drive(tmp_path)
    assert not list(reader.frames())
    assert any("size" in doubt for doubt in reader.doubts)


def test_what_lies_beside_pictures_is_named_where_it_is_missing(tmp_path: Path) -> None:
    (tmp_path / "rgb").mkdir()
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"rgb/{k}.png"), picture(k))
    for name in ("camera_calib.yaml", "trajectory.txt"):
        (tmp_path / name).write_text("?", encoding="utf-8")
    (tmp_path / "aligned_depth").mkdir()
    for folder in (tmp_path, tmp_path / "rgb"):
        summary = import_drive(open_drive(folder), tmp_path / f"{folder.name}.rrd", ImportOptions(every_m=0))
        said = " ".join(summary.doubts)
        assert all(name in said for name in ("camera_calib.yaml", "trajectory.txt", "aligned_depth"))


def test_an_odometry_file_that_does_not_exist_is_refused_with_those_beside(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
    (tmp_path / "odom_filtered.csv").write_text("stamp,x,y,yaw\n", encoding="utf-8")
    with pytest.raises(DriveError, match=r"odom_filtered\.csv"):
        open_drive(tmp_path, options=ReadOptions(odometry="odom.csv"))


def test_pictures_without_stamps_say_the_assumed_rate(tmp_path: Path) -> None:
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), picture(k))
    assumed = import_drive(open_drive(tmp_path), tmp_path / "a.rrd").doubts
    given = import_drive(open_drive(tmp_path, options=ReadOptions(rate_hz=5)), tmp_path / "b.rrd").doubts
    assert any("--rate" in doubt for doubt in assumed)
    assert not any("--rate" in doubt for doubt in given)


def test_depth_beside_is_matched_by_stamps_where_all_names_are_stamps(tmp_path: Path) -> None:
    for k in range(4):
        (tmp_path / "rgb").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / f"rgb/{1700000000 + k / 5:.6f}.png"), picture(k))
        write_depth(tmp_path / f"depth/{1700000000 + k / 5 + 0.011:.6f}.png", k)
    depths = [frame.depth_m for frame in open_drive(tmp_path).frames()]
    assert [float(depth[0, 0]) for depth in depths if depth is not None] == pytest.approx([1.0, 1.1, 1.2, 1.3])


def test_depth_that_was_counted_by_a_counter_of_its_own_is_doubted(tmp_path: Path) -> None:
    for k in range(6):
        (tmp_path / "rgb").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / f"rgb/{100 + k}.png"), picture(k))
        write_depth(tmp_path / f"depth/{102 + k}.png", k)
    assert any("counters" in doubt for doubt in open_drive(tmp_path).doubts)


def test_a_folder_of_several_drives_names_all_and_those_without_colours_last(tmp_path: Path) -> None:
    for name in ("a_confidence", "depths", "walk"):
        (tmp_path / name).mkdir()
        for k in range(2):
            image = picture(k) if name == "walk" else picture(k)[..., 0]
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), image)
    with pytest.raises(DriveError) as caught:
        open_drive(tmp_path)
    places = [str(caught.value).index(name) for name in ("walk", "a_confidence", "depths")]
    assert places == sorted(places)


@pytest.mark.parametrize("row", ["1, nan, 0, 0, 0, 0, 0, 0, 1", "1, 1e300, 0, 0, 0, 0, 0, 0, 1", "1, 0, 0"])
def test_a_row_that_is_no_pose_of_an_image_is_refused_by_its_line(tmp_path: Path, row: str) -> None:
    folder = write_stray(tmp_path / "scan")
    (folder / "odometry.csv").write_text(f"timestamp, frame, x, y, z, qx, qy, qz, qw\n{row}\n", encoding="utf-8")
    with pytest.raises(DriveError, match="line 2"):
        open_drive(folder)
