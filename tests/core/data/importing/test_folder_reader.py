"""A plain folder of pictures is a drive too, with what lies beside them, and what is wrong with it is said."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from ltvn_core.cameras import encoded_images
from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.folder_reader import FOLDER
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError
from tests.platforms import needs_posix


def write_pictures(folder: Path, names: list[str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((48, 64, 3), 10 * k, np.uint8))
    return folder


def read(folder: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(FOLDER.open(folder, options or ReadOptions()).frames())


def test_pictures_come_in_natural_order_with_stamps_by_the_rate(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path, ["img10.png", "img2.png", "img1.png", ".hidden.png"])
    frames = read(folder, ReadOptions(rate_hz=5))
    assert [frame.name for frame in frames] == ["img1.png", "img2.png", "img10.png"]
    assert [frame.stamp for frame in frames] == pytest.approx([0, 0.2, 0.4])
    assert open_drive(folder).facts.format == "folder"


@needs_posix
def test_a_folder_of_a_name_that_is_not_utf_8_becomes_a_recording(tmp_path: Path) -> None:
    pictures = write_pictures(tmp_path / "pictures", [f"{number}.png" for number in range(3)])
    folder = pictures.rename(tmp_path / os.fsdecode(b"caf\xe9"))
    import_drive(open_drive(folder), tmp_path / "drive.rrd")
    assert r"caf\xe9" in Recording.open(tmp_path / "drive.rrd").meta.scene


def test_names_that_are_seconds_are_stamps(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "rgb", ["1305031452.79.jpg", "1305031453.10.jpg"]).parent
    assert [frame.stamp for frame in read(folder)] == [1305031452.79, 1305031453.10]


def test_depth_of_the_same_name_is_in_millimetres_or_as_the_camera_file_says(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path, ["1.jpg", "2.jpg"])
    (folder / "depth").mkdir()
    cv2.imwrite(str(folder / "depth/2.png"), np.full((48, 64), 2500, np.uint16))
    frames = read(folder)
    assert frames[0].depth_m is None
    assert frames[1].depth_m is not None
    assert np.allclose(frames[1].depth_m, 2.5)
    fields = {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 319.5, "cy": 239.5, "depth_scale": 5000}
    (folder / "camera.json").write_text(json.dumps(fields), encoding="utf-8")
    again = read(folder)[1]
    assert again.depth_m is not None
    assert np.allclose(again.depth_m, 0.5)
    assert again.camera is not None
    assert again.camera.fx == 50


@pytest.mark.parametrize(
    "table",
    [
        "file,x,y,yaw\n2.jpg,1,2,0.5\n1.jpg,0,0,0\n",
        "stamp, x, y, z, yaw\n0.0,0,0,9,0\n0.1,1,2,9,0.5\n",
        "0.0,0,0,0\n0.11,1,2,0.5\n",
        "1,0,0,0\n2,1,2,0.5\n",
    ],
    ids=["by file", "by stamp", "without a heading", "by the stem"],
)
def test_a_table_of_odometry_finds_its_pictures(tmp_path: Path, table: str) -> None:
    folder = write_pictures(tmp_path / "drive", ["1.jpg", "2.jpg"])
    (folder / "odometry.csv").write_text(table, encoding="utf-8")
    assert [frame.odometry.tolist() for frame in read(folder) if frame.odometry is not None] == [[0, 0, 0], [1, 2, 0.5]]
    (folder / "odometry.csv").rename(tmp_path / "elsewhere.csv")
    assert [frame.odometry for frame in read(folder)] == [None, None]
    outside = read(folder, ReadOptions(odometry=str(tmp_path / "elsewhere.csv")))
    assert [frame.odometry is not None for frame in outside] == [True, True]


def test_a_picture_that_the_table_does_not_name_is_left_out_with_the_reason(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path / "drive", ["a.jpg", "b.jpg", "c.jpg"])
    (folder / "odometry.csv").write_text("file,x,y,yaw\na.jpg,0,0,0\nc.jpg,1,0,0\n", encoding="utf-8")
    summary = import_drive(FOLDER.open(folder, ReadOptions()), tmp_path / "tour.rrd")
    assert summary.dropped == {"no odometry at that time": 1}
    assert Recording.open(tmp_path / "tour.rrd").poses.odometry.tolist() == [[0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize("pose", ["nan,0,0", "0,inf,0", "0,0,-inf"])
def test_a_row_of_odometry_without_a_finite_pose_is_named_and_costs_only_its_picture(tmp_path: Path, pose: str) -> None:
    folder = write_pictures(tmp_path, [f"{k}.jpg" for k in range(4)])
    (folder / "odometry.csv").write_text(
        f"stamp,x,y,yaw\n0,0,0,0\n0.1,1,0,0\n0.2,{pose}\n0.3,3,0,0\n", encoding="utf-8"
    )
    reader = FOLDER.open(folder, ReadOptions())
    assert [frame.odometry is None for frame in reader.frames()] == [False, False, True, False]
    assert any("row 3" in doubt and "odometry.csv" in doubt for doubt in reader.doubts)


def test_a_table_of_odometry_in_reverse_order_gives_the_same_poses_with_a_doubt(tmp_path: Path) -> None:
    folder = write_pictures(tmp_path, [f"{k}.5.jpg" for k in range(4)])
    rows = [f"{k + 0.9},{k},0,0\n" for k in range(4)]
    found = []
    for order in (rows, rows[::-1]):
        (folder / "odometry.csv").write_text("stamp,x,y,yaw\n" + "".join(order), encoding="utf-8")
        reader = FOLDER.open(folder, ReadOptions())
        found.append(([None if f.odometry is None else f.odometry.tolist() for f in reader.frames()], reader.doubts))
    assert found[0][0] == found[1][0]
    assert any("do not increase" in doubt for doubt in found[1][1])
    assert not found[0][1]


def test_the_lens_of_a_phone_is_known_from_its_pictures(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    for name in ("a.jpg", "b.jpg"):
        Image.new("RGB", (400, 300), (90, 80, 70)).save(tmp_path / name, exif=exif)
    camera = read(tmp_path)[0].camera
    assert camera is not None
    assert np.degrees(camera.horizontal_fov_rad) == pytest.approx(67.3, abs=0.5)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("odometry.csv", "", "holds no rows"),
        ("odometry.csv", "file,x,y\n1.jpg,0,0\n", "has the columns file, x, y"),
        ("odometry.csv", "file,x,y,yaw\n1.jpg,0,north,0\n", "row 1 is 1.jpg,0,north,0"),
        ("odometry.csv", "\0\xff\xfe", "odometry.csv"),
        ("camera.json", "{}{}", "camera.json describes no camera"),
    ],
)
def test_a_table_or_camera_that_cannot_be_right_is_refused_in_one_line(
    tmp_path: Path, file: str, text: str, message: str
) -> None:
    (write_pictures(tmp_path, ["1.jpg", "2.jpg"]) / file).write_text(text, encoding="latin-1")
    with pytest.raises(DriveError, match=message) as refusal:
        read(tmp_path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("blob", [b"", b"\xff\xd8\xff\xe0" + b"\0" * 50, b"GIF89a" + b"\0" * 50, b"not a picture"])
def test_a_cut_or_foreign_picture_is_left_out_and_counted(tmp_path: Path, blob: bytes) -> None:
    (write_pictures(tmp_path, ["1.jpg", "2.jpg", "3.jpg"]) / "2.jpg").write_bytes(blob)
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert [frame.name for frame in reader.frames()] == ["1.jpg", "3.jpg"]
    assert reader.dropped == {"damaged or missing image": 1}
    assert "2.jpg" in reader.doubts[0]


@needs_posix
def test_pipes_and_links_in_a_circle_are_left_out_and_never_waited_for(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["1.jpg", "4.jpg"])
    os.mkfifo(tmp_path / "2.jpg")
    (tmp_path / "3.jpg").symlink_to(tmp_path / "3.jpg")
    os.mkfifo(tmp_path / "odometry.csv")
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert [frame.name for frame in reader.frames()] == ["1.jpg", "4.jpg"]
    assert reader.dropped == {"damaged or missing image": 2}
    assert "2.jpg is a pipe or a device" in reader.doubts[0]


@needs_posix
@pytest.mark.parametrize("table", ["/dev/zero", "pipe.csv"])
def test_a_table_that_would_never_end_is_refused(tmp_path: Path, table: str) -> None:
    os.mkfifo(write_pictures(tmp_path, ["1.jpg", "2.jpg"]) / "pipe.csv")
    with pytest.raises(DriveError, match="is a pipe or a device"):
        FOLDER.open(tmp_path, ReadOptions(odometry=str(tmp_path / table)))


@pytest.mark.parametrize("extension", [".png", ".jpg", ".bmp", ".tiff"])
def test_of_a_damaged_picture_one_line_is_said_and_none_by_the_libraries_that_decode_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], extension: str
) -> None:
    name = f"2{extension}"
    picture = (write_pictures(tmp_path, ["1.jpg", name, "3.jpg"]) / name).read_bytes()
    middle = len(picture) // 2
    for damaged in (picture[:middle], picture[:-6]):
        (tmp_path / name).write_bytes(damaged)
        reader = FOLDER.open(tmp_path, ReadOptions())
        assert [frame.name for frame in reader.frames()] == ["1.jpg", "3.jpg"]
        assert len(reader.doubts) == 1
        assert "\n" not in reader.doubts[0]
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("alpha", "is_doubted"), [(0, True), (1, False), (255, False)])
def test_pictures_that_are_fully_transparent_are_a_doubt(tmp_path: Path, alpha: int, is_doubted: bool) -> None:
    for name in ("1.png", "2.png"):
        cv2.imwrite(str(tmp_path / name), np.full((48, 64, 4), (90, 80, 70, alpha), np.uint8))
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert len(list(reader.frames())) == 2
    assert any("transparent" in doubt for doubt in reader.doubts) == is_doubted


@pytest.mark.parametrize("inside", ["", "rgb"])
def test_a_folder_of_one_picture_is_refused_by_the_number_and_not_by_the_format(tmp_path: Path, inside: str) -> None:
    write_pictures(tmp_path / "drive" / inside, ["1.png"])
    with pytest.raises(DriveError, match="one picture") as refusal:
        open_drive(tmp_path / "drive")
    assert "format" not in str(refusal.value)


def test_a_folder_without_pictures_is_no_drive(tmp_path: Path) -> None:
    assert not FOLDER.recognises(tmp_path)
    with pytest.raises(DriveError, match="contains no images"):
        FOLDER.open(tmp_path, ReadOptions())
    with pytest.raises(DriveError, match="holds no depth images"):
        FOLDER.open(write_pictures(tmp_path, ["1.jpg", "2.jpg"]), ReadOptions(depth="deep"))


def write_depth(path: Path, millimetres: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((48, 64), millimetres, np.uint16)
    image[0] = 65535  # No return, as many cameras write it.
    cv2.imwrite(str(path), image)


@pytest.mark.parametrize(
    ("colour", "depth"),
    [
        ("frame{:06d}.jpg", "depth{:06d}.png"),
        ("frame-{:06d}.color.png", "frame-{:06d}.depth.png"),
        ("color_{:04d}.png", "depth_{:04d}.png"),
        ("{}.jpg", "{}.tiff"),
        ("rgb_{}.png", "../depth/d{:03d}.png"),
    ],
)
def test_depth_in_the_folder_of_the_colours_is_told_apart_and_paired(tmp_path: Path, colour: str, depth: str) -> None:
    folder = tmp_path / "results"
    write_pictures(folder, [colour.format(k) for k in range(8, 12)])
    for k in range(9, 12):
        write_depth(folder / depth.format(k), 100 * k)
    reader = open_drive(tmp_path)
    frames = list(reader.frames())
    assert [Path(frame.name).name for frame in frames] == [colour.format(k) for k in range(8, 12)]
    assert frames[0].depth_m is None
    assert [frame.depth_m[1, 0] for frame in frames[1:] if frame.depth_m is not None] == pytest.approx([0.9, 1, 1.1])
    assert all(frame.depth_m is None or (frame.depth_m[0] == 0).all() for frame in frames)
    assert not reader.doubts
    assert all(frame.depth_m is None for frame in read(tmp_path, ReadOptions(depth="none")))


def test_deep_pictures_without_a_colour_image_are_named_unless_a_person_wants_no_depth(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["1.png", "3.png"])
    for name in ("2.png", "4.png"):
        write_depth(tmp_path / name, 1000)
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert [frame.name for frame in reader.frames()] == ["1.png", "3.png"]
    assert "2 images such as 2.png" in reader.doubts[0]
    assert not FOLDER.open(tmp_path, ReadOptions(depth="none")).doubts


def test_a_folder_of_depth_alone_asks_for_the_colours(tmp_path: Path) -> None:
    for k in range(3):
        write_depth(tmp_path / f"{k}.png", 1000)
    with pytest.raises(DriveError, match="no colour images"):
        read(tmp_path)


def test_pictures_of_depth_for_the_eye_are_neither_colours_nor_depth(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["color_0.png", "color_1.png", "depth_0.png", "depth_1.png"])
    reader = FOLDER.open(tmp_path, ReadOptions())
    frames = list(reader.frames())
    assert [frame.name for frame in frames] == ["color_0.png", "color_1.png"]
    assert [frame.depth_m for frame in frames] == [None, None]
    assert "8 bits" in reader.doubts[0]


def test_pictures_of_a_kind_that_is_not_read_are_counted_and_named(tmp_path: Path) -> None:
    write_pictures(tmp_path, ["1.jpg", "2.jpg"])
    for name in ("3.DNG", "4.dng"):
        (tmp_path / name).write_bytes(b"raw")
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert len(list(reader.frames())) == 2
    assert sum(reader.dropped.values()) == 2
    assert "2 .dng" in reader.doubts[0]
    for name in ("1.jpg", "2.jpg"):
        (tmp_path / name).unlink()
    with pytest.raises(DriveError, match=r"2 \.dng.*magick mogrify"):
        open_drive(tmp_path)


def test_heic_pictures_of_a_phone_are_read_with_their_lens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pillow_heif = pytest.importorskip("pillow_heif")
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    write_pictures(tmp_path, ["1.jpg"])
    for name in ("2.HEIC", "3.heic"):
        picture = pillow_heif.from_pillow(Image.new("RGB", (64, 48), (200, 100, 50)))
        picture.save(tmp_path / name, exif=exif.tobytes())
    frames = read(tmp_path)
    assert [frame.name for frame in frames] == ["1.jpg", "2.HEIC", "3.heic"]
    assert np.abs(frames[1].rgb.reshape(-1, 3).mean(axis=0) - [200, 100, 50]).max() < 5
    assert frames[1].camera is not None
    assert np.degrees(frames[1].camera.horizontal_fov_rad) == pytest.approx(67.3, abs=0.5)

    (tmp_path / "3.heic").write_bytes((tmp_path / "2.HEIC").read_bytes()[:100])
    assert [frame.name for frame in read(tmp_path)] == ["1.jpg", "2.HEIC"]

    monkeypatch.setattr(encoded_images, "is_installed", lambda _: False)
    reader = FOLDER.open(tmp_path, ReadOptions())
    assert [frame.name for frame in reader.frames()] == ["1.jpg"]
    assert reader.dropped == {"damaged or missing image": 2}
    assert "pip install 'ltvn[import]'" in reader.doubts[0]


def test_a_jpeg_that_is_called_heic_is_read(tmp_path: Path) -> None:
    for name in ("1.jpg", "2.jpg"):
        (write_pictures(tmp_path, [name]) / name).rename(tmp_path / name.replace(".jpg", ".HEIC"))
    assert len(list(open_drive(tmp_path).frames())) == 2


def test_replica_as_nice_slam_has_it_comes_with_its_lens_and_unit_of_depth(tmp_path: Path) -> None:
    write_pictures(tmp_path / "results", ["frame000000.jpg", "frame000001.jpg"])
    write_depth(tmp_path / "results/depth000001.png", 13107)
    camera = {"w": 64, "h": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "scale": 6553.5}
    (tmp_path / "cam_params.json").write_text(json.dumps({"camera": camera}), encoding="utf-8")
    frame = read(tmp_path)[1]
    assert frame.depth_m is not None
    assert frame.depth_m[1, 0] == pytest.approx(2.0)
    assert frame.camera is not None
    assert frame.camera.fx == 60
    (tmp_path / "cam_params.json").write_text("{}", encoding="utf-8")
    with pytest.raises(DriveError, match=r"cam_params\.json describes no camera"):
        read(tmp_path)


def poses_along_x(count: int) -> list[str]:
    """Return 4 x 4 matrices, camera to world, of a level camera that drives 0.2 m a picture along the world's x."""
    return [f"0 0 1 {0.2 * k}\n-1 0 0 1.5\n0 -1 0 0.6\n0 0 0 1\n" for k in range(count)]


@pytest.mark.parametrize("layout", ["7-scenes", "scannet", "replica"])
def test_poses_that_lie_beside_pictures_are_true_poses(tmp_path: Path, layout: str) -> None:
    poses = poses_along_x(3)
    if layout == "7-scenes":
        write_pictures(tmp_path, [f"frame-{k:06d}.color.png" for k in range(3)])
        for k, pose in enumerate(poses):
            (tmp_path / f"frame-{k:06d}.pose.txt").write_text(pose, encoding="utf-8")
    elif layout == "scannet":
        write_pictures(tmp_path / "color", [f"{k}.jpg" for k in range(3)])
        (tmp_path / "pose").mkdir()
        for k, pose in enumerate(poses):
            (tmp_path / f"pose/{k}.txt").write_text(pose if k != 1 else pose.replace("1.5", "-inf"), encoding="utf-8")
    else:
        write_pictures(tmp_path / "results", [f"frame{k:06d}.jpg" for k in range(3)])
        rows = "".join(pose.replace("\n", " ") + "\n" for pose in poses)
        (tmp_path / "traj.txt").write_text(rows, encoding="utf-8")
    frames = read(tmp_path)
    assert [None if f.truth is None else round(float(f.truth[0]), 3) for f in frames] == [
        0.0,
        None if layout == "scannet" else 0.2,
        0.4,
    ]
    assert frames[2].truth is not None
    np.testing.assert_allclose(frames[2].truth, [0.4, 1.5, 0.0], atol=1e-9)


def test_depth_of_a_phone_that_is_not_sure_is_no_depth(tmp_path: Path) -> None:
    write_pictures(tmp_path / "rgb", ["1.png", "2.png"])
    for k in (1, 2):
        (tmp_path / "depth").mkdir(exist_ok=True)
        write_depth(tmp_path / f"depth/{k}.png", 2000)
        sure = np.zeros_like(cv2.imread(str(tmp_path / f"depth/{k}.png"), cv2.IMREAD_UNCHANGED), np.uint8)
        sure[:, 1:] = 2
        (tmp_path / "confidence").mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / f"confidence/{k}.png"), sure)
    depth = read(tmp_path)[0].depth_m
    assert depth is not None
    assert (depth[:, 0] == 0).all()
    assert (depth[1:, 1:] == 2).all()


def test_rows_of_poses_for_other_pictures_are_refused(tmp_path: Path) -> None:
    write_pictures(tmp_path / "results", [f"frame{k:06d}.jpg" for k in range(3)])
    (tmp_path / "traj.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n", encoding="utf-8")
    with pytest.raises(DriveError, match="16 for each of the 3"):
        FOLDER.open(tmp_path, ReadOptions())


def test_a_folder_of_videos_is_refused_with_the_path_to_import(tmp_path: Path) -> None:
    (tmp_path / "VID_1.MP4").write_bytes(b"\x00\x00\x00\x18ftypmp42")
    with pytest.raises(DriveError, match=r"own path.*VID_1\.MP4"):
        open_drive(tmp_path)
