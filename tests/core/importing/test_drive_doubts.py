"""What is doubtful of a drive that comes in is said with the likely cause and what to do."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ltvn_core.importing.drive_import import import_drive
from ltvn_core.importing.import_options import ImportOptions
from ltvn_core.importing.import_summary import ImportSummary
from ltvn_core.importing.raw_frame import RawFrame
from tests.core.importing.drives import ListedDrive
from tests.core.importing.test_drive_import import frame

ALL = ImportOptions(every_m=0, every_deg=0)


def imported(tmp_path: Path, drive: Iterable[RawFrame], roles: tuple[str, ...] = ("rgb", "odometry")) -> ImportSummary:
    return import_drive(ListedDrive(drive, roles), tmp_path / "tour.rrd", ALL)


def said(summary: ImportSummary) -> str:
    return " ".join(summary.doubts)


def noisy(raw: RawFrame) -> RawFrame:
    noise = np.random.default_rng(round(raw.stamp * 10)).integers(0, 9, raw.rgb.shape, np.uint8)
    return replace(raw, rgb=raw.rgb // 2 + noise)


def with_depth(raw: RawFrame) -> RawFrame:
    return replace(raw, depth_m=np.ones(raw.rgb.shape[:2], np.float32))


def test_a_good_drive_is_not_doubted(tmp_path: Path) -> None:
    drive = [with_depth(noisy(frame(k, x=0.1 * k))) for k in range(25)]
    assert imported(tmp_path, drive, ("rgb", "depth", "odometry")).doubts == ()


def test_a_camera_that_stands_still_while_the_robot_drives_is_told(tmp_path: Path) -> None:
    drive = [with_depth(frame(k, x=0.1 * k)) for k in range(25)]
    (doubt,) = imported(tmp_path, drive, ("rgb", "depth", "odometry")).doubts
    assert "does the camera stand still" in doubt


def test_pauses_of_the_recorder_are_told(tmp_path: Path) -> None:
    stamps = [k / 10 + 5 * (k // 8) for k in range(32)]
    summary = imported(tmp_path, [replace(frame(k, x=0.1 * k), stamp=s) for k, s in enumerate(stamps)])
    assert summary.gaps == 3
    assert round(summary.longest_gap_s, 1) == 5.1
    assert "For 3 times, 15 s in all, no images came" in said(summary)


def test_images_in_a_row_that_cannot_overlap_are_told(tmp_path: Path) -> None:
    summary = imported(tmp_path, [frame(k, x=1.5 * k) for k in range(25)])
    assert "24 of 24 images in a row do not overlap" in said(summary)
    assert "falls into 25 pieces" in said(summary)


def test_odometry_in_another_unit_shows_as_drift(tmp_path: Path) -> None:
    drive = [replace(frame(k, x=0.1 * k), truth=np.array([0.1 * k * 2.54, 0, 0])) for k in range(40)]
    summary = imported(tmp_path, drive, ("rgb", "odometry", "truth"))
    assert summary.drift is not None
    assert "is it in metres" in said(summary)


def test_images_without_depth_among_others_are_counted(tmp_path: Path) -> None:
    drive = [frame(k, x=0.1 * k) if k % 5 == 0 else with_depth(frame(k, x=0.1 * k)) for k in range(25)]
    summary = imported(tmp_path, drive, ("rgb", "depth", "odometry"))
    assert summary.without_depth == 5
    assert "5 of 25 images have no depth" in said(summary)


def test_images_too_small_to_recognise_anything_in_are_told(tmp_path: Path) -> None:
    whole = [frame(k, x=0.1 * k) for k in range(25)]
    small = [
        replace(raw, rgb=raw.rgb[::4, ::4], camera=None if raw.camera is None else raw.camera.scaled(80, 60))
        for raw in whole
    ]
    assert "pixels wide" not in said(imported(tmp_path, whole))
    (tmp_path / "tour.rrd").unlink()
    assert "images are 80 pixels wide" in said(imported(tmp_path, small))
