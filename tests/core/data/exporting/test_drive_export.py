"""A drive in another program's format is read by that program's library, and comes back as it was by our own reader."""

import json
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.exporting.recording_export import ExportFormat, export_recording
from ltvn_core.data.importing.raw_frame import RawFrame, ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import LtvnError, RecordingError
from ltvn_core.types import Observation, Tilt

CAMERA = CameraModel.from_fov(64, 48, 1.2, height_m=0.55, pitch_rad=-0.15)
COUNT = 5


def observation(step: int, tilt: Tilt | None = None) -> Observation:
    rows, columns = np.mgrid[:48, :64]
    rgb = np.stack([rows * 4, columns * 3, np.full_like(rows, 30 * step)], axis=-1).astype(np.uint8)
    depth = np.full((48, 64), 1 + 0.5 * step, np.float32)
    depth[:4] = 0
    pose = np.array([0.2 * step, 0.1 * step, 0.3 * step - 0.5])
    return Observation(
        rgb=rgb, depth=depth, odometry=pose, stamp=100 + 0.5 * step, step=step, exact_pose=pose + 0.01, tilt=tilt
    )


def written(path: Path, tilt: Tilt | None = None) -> Recording:
    with RecordingWriter(path, scene="test", config={}, fingerprint="none", camera=CAMERA) as writer:
        for step in range(COUNT):
            writer.write_frame(observation(step, tilt))
    return Recording.open(path)


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return written(tmp_path / "tour.rrd")


def read_back(path: Path, options: ReadOptions | None = None) -> list[RawFrame]:
    return list(open_drive(path, options=options).frames())


def check_frames(frames: list[RawFrame], recording: Recording, *, depth_within_m: float | None) -> None:
    assert len(frames) == COUNT
    for frame, step in zip(frames, recording.frames, strict=True):
        seen = recording.observation(step)
        assert np.array_equal(frame.rgb, seen.rgb)
        assert frame.odometry == pytest.approx(seen.odometry, abs=1e-6)
        if depth_within_m is None:
            assert frame.depth_m is None
        else:
            assert frame.depth_m is not None
            assert seen.depth is not None
            assert np.allclose(frame.depth_m, seen.depth, atol=depth_within_m)


def check_camera(camera: CameraModel | None) -> None:
    assert camera is not None
    assert (camera.width, camera.height) == (64, 48)
    found = (camera.fx, camera.fy, camera.cx, camera.cy, camera.height_m, camera.pitch_rad)
    assert found == pytest.approx((CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 0.55, -0.15), abs=1e-6)


@pytest.mark.parametrize("name", ["tour.mcap", "tour"])
def test_a_bag_comes_back_and_is_read_by_rosbags(tmp_path: Path, recording: Recording, name: str) -> None:
    done = export_recording(recording, tmp_path / "out" / name, ExportFormat.MCAP)

    frames = read_back(tmp_path / "out" / name)

    assert done.frames == COUNT
    assert (tmp_path / "out" / name).is_file() == name.endswith(".mcap")
    check_frames(frames, recording, depth_within_m=1e-6)
    check_camera(frames[0].camera)
    assert frames[2].truth == pytest.approx(observation(2).exact_pose, abs=1e-6)
    assert [frame.stamp for frame in frames] == pytest.approx([100, 100.5, 101, 101.5, 102], abs=1e-6)
    with AnyReader([tmp_path / "out" / name]) as bag:
        kinds = {each.topic: each.msgtype for each in bag.connections}
        assert kinds["/odom"] == "nav_msgs/msg/Odometry"
        assert kinds["/tf_static"] == "tf2_msgs/msg/TFMessage"
        for connection, _, data in bag.messages():
            bag.deserialize(data, connection.msgtype)


@pytest.mark.parametrize("name", ["tour.mcap", "tour"])
def test_humble_can_play_a_bag_and_gets_its_fixed_frames_latched(
    tmp_path: Path, recording: Recording, name: str
) -> None:
    export_recording(recording, tmp_path / name, ExportFormat.MCAP)

    with Reader(tmp_path / name) as bag:
        profiles = {each.topic: each.ext.offered_qos_profiles for each in bag.connections}  # type: ignore[union-attr]
    assert [profile.durability for profile in profiles["/tf_static"]] == [QosDurability.TRANSIENT_LOCAL]
    assert profiles["/tf"] == []
    if (tmp_path / name).is_dir():
        metadata = YAML(typ="safe").load(tmp_path / name / "metadata.yaml")["rosbag2_bagfile_information"]
        assert metadata["version"] <= 8
        topics = [each["topic_metadata"] for each in metadata["topics_with_message_count"]]
        assert all(isinstance(each["offered_qos_profiles"], str) for each in topics)


def test_a_tilt_that_changes_survives_in_a_bag_and_in_a_tum_folder(tmp_path: Path) -> None:
    recording = written(tmp_path / "tour.rrd", Tilt(0.25, 0.1))

    export_recording(recording, tmp_path / "bag", ExportFormat.MCAP)
    export_recording(recording, tmp_path / "folder", ExportFormat.TUM)

    camera = read_back(tmp_path / "bag")[1].camera
    assert camera is not None
    assert (camera.pitch_rad, camera.roll_rad) == (pytest.approx(0.25), pytest.approx(0.1))
    assert read_back(tmp_path / "folder")[1].tilt == pytest.approx((0.25, 0.1), abs=1e-6)


def test_a_tum_folder_comes_back_and_is_read_by_numpy(tmp_path: Path, recording: Recording) -> None:
    export_recording(recording, tmp_path / "folder", ExportFormat.TUM)

    frames = read_back(tmp_path / "folder")

    check_frames(frames, recording, depth_within_m=1e-4)
    check_camera(frames[0].camera)
    truth = np.loadtxt(tmp_path / "folder/groundtruth.txt")
    assert truth.shape == (COUNT, 8)
    assert truth[2, 1:4] == pytest.approx([0.41, 0.21, 0.55])
    listed = (tmp_path / "folder/depth.txt").read_text(encoding="utf-8").splitlines()[2].split()[1]
    depth = cv2.imread(str(tmp_path / "folder" / listed), cv2.IMREAD_UNCHANGED)
    assert depth is not None
    assert depth.max() == 7500


def test_a_vint_folder_comes_back(tmp_path: Path, recording: Recording) -> None:
    export_recording(recording, tmp_path / "folder", ExportFormat.VINT)

    frames = read_back(tmp_path / "folder", ReadOptions(rate_hz=2.0))

    check_frames(frames, recording, depth_within_m=None)
    check_camera(frames[0].camera)


def test_a_lerobot_data_set_comes_back_and_is_read_by_pyarrow(tmp_path: Path, recording: Recording) -> None:
    export_recording(recording, tmp_path / "set", ExportFormat.LEROBOT)

    frames = read_back(tmp_path / "set")

    check_frames(frames, recording, depth_within_m=1e-6)
    check_camera(frames[0].camera)
    table = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet")
    info = json.loads((tmp_path / "set/meta/info.json").read_text(encoding="utf-8"))
    assert info["total_frames"] == table.num_rows == COUNT
    assert set(info["features"]) == set(table.column_names)
    assert np.array(table["observation.time"].to_pylist())[:, 0] == pytest.approx([100, 100.5, 101, 101.5, 102])
    # Half a second a row, 0.3 radians and 22 cm along an arc each.
    assert np.array(table["action"].to_pylist())[1, 1] == pytest.approx(0.6)
    assert pq.read_table(tmp_path / "set/meta/tasks.parquet").num_rows == 1


def test_frames_between_two_moments_alone_are_written(tmp_path: Path, recording: Recording) -> None:
    done = export_recording(recording, tmp_path / "folder", ExportFormat.VINT, from_s=100.4, to_s=101.1)

    assert done.frames == 2
    with pytest.raises(RecordingError, match="none of them"):
        export_recording(recording, tmp_path / "none", ExportFormat.VINT, from_s=900)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("to", list(ExportFormat))
def test_nothing_is_ever_overwritten_and_nothing_is_left_behind(
    tmp_path: Path, recording: Recording, to: ExportFormat
) -> None:
    target = tmp_path / "out" / "taken"
    target.mkdir(parents=True)
    (target / "diary.txt").write_text("mine", encoding="utf-8")

    with pytest.raises(LtvnError, match=r"exists already|holds no map"):
        export_recording(recording, target, to)
    assert [file.name for file in (tmp_path / "out").rglob("*")] == ["taken", "diary.txt"]
