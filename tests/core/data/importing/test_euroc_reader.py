"""Sequences in the ASL layout of EuRoC come with their lens and the true poses of the camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.euroc_reader import EUROC
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError

BEGIN_NS = 1_403_636_579_763_555_584
STEP_NS = 50_000_000
ON_BODY = """\
T_BS:
  cols: 4
  rows: 4
  data: [0.0, 0.0, 1.0, 0.1,
         -1.0, 0.0, 0.0, 0.2,
         0.0, -1.0, 0.0, 0.3,
         0.0, 0.0, 0.0, 1.0]
"""
"""A camera that looks ahead, mounted ahead of, beside and above the body's origin."""
SENSOR = f"""\
# General sensor definitions.
sensor_type: camera
comment: VI-Sensor cam0 (MT9M034)
{ON_BODY}rate_hz: 20
resolution: [752, 480]
camera_model: pinhole
intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""


def write_sequence(folder: Path, frames: int = 4, sensor: str = SENSOR) -> Path:
    """Write a body that drives along y, 0.2 m an image, and looks there."""
    camera, truth = folder / "mav0/cam0", folder / "mav0/state_groundtruth_estimate0"
    for each in (camera / "data", truth):
        each.mkdir(parents=True)
    stamps = [BEGIN_NS + k * STEP_NS for k in range(frames)]
    rng = np.random.default_rng(0)
    for stamp in stamps:
        cv2.imwrite(str(camera / f"data/{stamp}.png"), rng.integers(0, 255, (120, 188), np.uint8))
    (camera / "data.csv").write_text(
        "#timestamp [ns],filename\r\n" + "".join(f"{s},{s}.png\r\n" for s in stamps), encoding="utf-8"
    )
    (camera / "sensor.yaml").write_text(sensor, encoding="utf-8")
    w = np.sqrt(0.5)
    lines = [f"{s},1.0,{0.2 * k},0.5,{w},0,0,{w},0,0,0" for k, s in enumerate(stamps)]
    (truth / "data.csv").write_text("#timestamp, p_RS_R_x [m]\n" + "\n".join(lines), encoding="utf-8")
    return folder


def read(folder: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(EUROC.open(folder, options or ReadOptions()).frames())


@pytest.mark.parametrize("name", ["", "mav0", "mav0/cam0"])
def test_a_sequence_comes_in_with_its_lens_and_the_poses_of_the_camera(tmp_path: Path, name: str) -> None:
    folder = write_sequence(tmp_path / "MH_01") / name

    frames = read(folder)

    assert EUROC.recognises(folder)
    assert EUROC.open(folder, ReadOptions()).facts.place == "MH_01"
    assert [frame.stamp - BEGIN_NS * 1e-9 for frame in frames] == pytest.approx([0, 0.05, 0.1, 0.15], abs=1e-5)
    # The body looks along y, so 0.1 m ahead of it is y, and 0.2 m to its left is -x.
    assert frames[2].truth == pytest.approx([0.8, 0.5, np.pi / 2], abs=1e-9)
    assert frames[2].tilt == pytest.approx((0, 0), abs=1e-9)
    camera = frames[0].camera
    assert camera is not None
    assert (camera.width, camera.height, camera.fisheye) == (188, 120, False)
    assert camera.fx == pytest.approx(458.654 / 4)
    assert camera.distortion == pytest.approx((-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05))
    assert (np.ptp(frames[0].rgb, axis=2) == 0).all()


def test_a_sequence_becomes_a_recording(tmp_path: Path) -> None:
    summary = import_drive(EUROC.open(write_sequence(tmp_path / "MH_01"), ReadOptions()), tmp_path / "tour.rrd")
    assert summary.frames == 4
    assert Recording.open(tmp_path / "tour.rrd").poses.odometry[:, 1] == pytest.approx([0.1, 0.3, 0.5, 0.7], abs=1e-6)


def test_a_fisheye_a_second_camera_and_a_sequence_without_lists_are_read(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path, sensor=SENSOR.replace("radial-tangential", "equidistant"))
    (folder / "mav0/cam0").rename(folder / "mav0/cam1")
    (folder / "mav0/cam1/data.csv").unlink()
    (folder / "mav0/state_groundtruth_estimate0/data.csv").unlink()

    frames = read(folder, ReadOptions(rgb="cam1"))

    assert len(frames) == 4
    assert frames[0].truth is None
    assert frames[0].camera is not None
    assert frames[0].camera.fisheye
    with pytest.raises(DriveError, match="there are cam1"):
        read(folder)


def test_poses_of_another_sensor_are_turned_to_the_camera(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path)
    # The poses are of a marker that sits where the camera does, so they are the camera's own.
    (folder / "mav0/state_groundtruth_estimate0/sensor.yaml").write_text(ON_BODY, encoding="utf-8")
    truth = read(folder)[2].truth
    assert truth is not None
    assert truth[:2] == pytest.approx([1.0, 0.4], abs=1e-9)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("cam0/data.csv", "#timestamp [ns],filename\n"),
        ("cam0/data.csv", "yesterday,1.png\n"),
        ("cam0/sensor.yaml", SENSOR.replace("752, 480", "752")),
        ("cam0/sensor.yaml", SENSOR.replace("458.654", "nan")),
        ("cam0/sensor.yaml", SENSOR.replace("458.654", "[1, 2")),
        ("cam0/sensor.yaml", SENSOR.replace("-1.0", "-7.0")),
        ("cam0/sensor.yaml", "\0" * 1000),
        ("state_groundtruth_estimate0/data.csv", f"{BEGIN_NS},0,0,0,0,0,0,0\n"),
        ("state_groundtruth_estimate0/data.csv", f"{BEGIN_NS},0,0,0,north,0,0,0\n"),
    ],
)
def test_files_that_cannot_be_right_are_refused_in_one_line(tmp_path: Path, file: str, text: str) -> None:
    (write_sequence(tmp_path) / "mav0" / file).write_text(text, encoding="utf-8")
    with pytest.raises(DriveError) as refusal:
        read(tmp_path)
    assert "\n" not in str(refusal.value)
