"""The unit of depth in a bag: doubted where it cannot be right, and said by the depth_scale of a camera.json."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError
from ltvn_core.verbs.import_drive import ImportVerb
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, bag, colours, planar, png


def drive(path: Path, depth: NDArray, encoding: str) -> Path:
    with bag(path) as builder:
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        for number in range(3):
            stamp = BEGIN_S + 0.1 * number
            builder.odometry("/odom", planar(0.1 * number, 0, 0), stamp)
            builder.image("/camera/color/image_raw", colours(number), "rgb8", stamp)
            if encoding == "png":
                builder.compressed("/camera/depth/image_raw/compressed", png(depth), "16UC1; png compressed ", stamp)
            else:
                builder.image("/camera/depth/image_raw", depth, encoding, stamp)
    return path


def filled(value: float, dtype: type[np.generic]) -> NDArray:
    return np.full((48, 64), value, dtype)


def median_m(path: Path) -> float:
    recording = Recording.open(path)
    depth = recording.observation(recording.frames[0]).depth
    assert depth is not None
    return float(np.median(depth))


def camera_file(path: Path, depth_scale: float) -> str:
    path.write_text(json.dumps({"depth_scale": depth_scale}), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("units", "dtype", "encoding", "depth_scale", "metres"),
    [
        (2, np.uint16, "16UC1", 1, 2.0),
        (14_745, np.uint16, "16UC1", 6553.5, 2.25),
        (60_000, np.uint16, "mono16", 5000, 12.0),
        (2, np.uint16, "png", 1, 2.0),
    ],
)
def test_depth_that_cannot_be_right_is_doubted_and_its_unit_can_be_said(
    tmp_path: Path, units: float, dtype: type[np.generic], encoding: str, depth_scale: float, metres: float
) -> None:
    path = drive(tmp_path / "drive", filled(units, dtype), encoding)

    doubtful = ImportVerb(source=path, output=tmp_path / "doubtful.rrd").run()
    said = camera_file(tmp_path / "camera.json", depth_scale)
    ImportVerb(source=path, output=tmp_path / "right.rrd", camera=said).run()

    assert any("depth_scale" in doubt for doubt in doubtful.doubts)  # type: ignore[attr-defined]
    assert median_m(tmp_path / "right.rrd") == pytest.approx(metres, abs=2e-3)


def test_floats_in_millimetres_are_refused_and_that_advice_works(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive", filled(2250.0, np.float32), "32FC1")

    with pytest.raises(DriveError, match="depth_scale"):
        ImportVerb(source=path, output=tmp_path / "wrong.rrd").run()
    said = camera_file(tmp_path / "camera.json", 0.001)
    summary = ImportVerb(source=path, output=tmp_path / "right.rrd", camera=said).run()

    assert median_m(tmp_path / "right.rrd") == pytest.approx(2.25, abs=1e-3)
    assert not any("depth_scale" in doubt for doubt in summary.doubts)  # type: ignore[attr-defined]


def test_a_camera_file_that_says_nothing_is_refused(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive", filled(2000, np.uint16), "16UC1")
    (tmp_path / "camera.json").write_text("{}", encoding="utf-8")

    with pytest.raises(DriveError, match="depth_scale"):
        ImportVerb(source=path, output=tmp_path / "tour.rrd", camera=str(tmp_path / "camera.json")).run()
