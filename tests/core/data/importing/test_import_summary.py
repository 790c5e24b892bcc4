"""What is doubtful of a drive that comes in is said with the likely cause and what to do."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions
from ltvn_core.data.importing.import_summary import ImportSummary
from ltvn_core.data.importing.raw_frame import RawFrame
from tests.core.data.importing.drives import ListedDrive
from tests.core.data.importing.test_drive_import import frame

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
    assert "has the camera stopped" in doubt


def test_pauses_of_the_recorder_are_told(tmp_path: Path) -> None:
    stamps = [k / 10 + 5 * (k // 8) for k in range(32)]
    summary = imported(tmp_path, [replace(frame(k, x=0.1 * k), stamp=s) for k, s in enumerate(stamps)])
    assert summary.gaps == 3
    assert round(summary.longest_gap_s, 1) == 5.1
    assert "For 3 times, 15 s in all" in said(summary)


def test_the_likely_cause_of_images_left_out_is_that_of_their_reason(tmp_path: Path) -> None:
    drive = [frame(k, x=0.1 * k) for k in range(24)]
    (tmp_path / "short").mkdir()
    half = imported(tmp_path / "short", [replace(raw, odometry=None) if k > 11 else raw for k, raw in enumerate(drive)])
    assert "12 images could not be used" in said(half)
    assert "Odometry is missing" in said(half)
    alike = imported(tmp_path, [replace(raw, stamp=9.0) for raw in drive])
    assert "stamps" in said(alike)
    assert not any("cut off" in said(summary) for summary in (half, alike))


def test_images_in_a_row_that_cannot_overlap_are_told(tmp_path: Path) -> None:
    summary = imported(tmp_path, [frame(k, x=1.5 * k) for k in range(25)])
    assert "24 of 24 images do not overlap" in said(summary)
    assert "25 pieces" in said(summary)


def test_a_yaw_in_degrees_is_told_by_a_question_for_the_unit(tmp_path: Path) -> None:
    drive = [replace(frame(k, x=0.05 * k), odometry=np.array([0.05 * k, 0, 9.0 * k])) for k in range(25)]
    assert "If its poses are in metres and radians" in said(imported(tmp_path, drive))


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


def test_the_forecast_joins_images_in_a_row_as_the_builder_does_by_odometry(tmp_path: Path) -> None:
    turning = [frame(k, x=0.7 * k, yaw=0.4 * (k % 2)) for k in range(25)]
    assert imported(tmp_path, turning).pieces_expected == 1
    (tmp_path / "tour.rrd").unlink()
    carried = [replace(raw, stamp=raw.stamp + 8.0 * (k >= 10)) for k, raw in enumerate(turning)]
    summary = imported(tmp_path, carried)
    assert summary.pieces_expected == 2
    assert summary.largest_piece_expected == 0.6


def test_a_spacing_that_nothing_can_measure_is_said_to_be_ignored_with_what_works(tmp_path: Path) -> None:
    drive = [replace(noisy(frame(k)), odometry=None) for k in range(5)] * 2
    drive = [replace(raw, stamp=k / 10) for k, raw in enumerate(drive)]

    def words(name: str, options: ImportOptions) -> str:
        return said(import_drive(ListedDrive(drive), tmp_path / name, options))

    assert "--every-m and --every-deg were ignored" in words("own.rrd", ImportOptions(every_m=0.5))
    usual = words("usual.rrd", ImportOptions())
    assert "ignored" not in usual
    assert "--every-m 0 --every-deg 0 keeps every image" in usual
    assert "every-m" not in words("all.rrd", ALL)


def test_metres_are_advised_only_where_images_were_left_out_for_them(tmp_path: Path) -> None:
    far = [frame(k, x=1.5 * k) for k in range(25)]
    assert "--every-m" not in said(imported(tmp_path, far))
    still = [replace(raw, stamp=raw.stamp + 0.05) for raw in far]
    drive = sorted([*far, *still], key=lambda raw: raw.stamp)
    summary = import_drive(ListedDrive(drive, ("rgb", "odometry")), tmp_path / "thin.rrd", ImportOptions())
    assert "lower --every-m" in said(summary)


def test_depth_that_looks_like_a_z_buffer_is_doubted(tmp_path: Path) -> None:
    def seen(k: int, first: float, last: float) -> RawFrame:
        raw = noisy(frame(k, x=0.1 * k))
        height, width = raw.rgb.shape[:2]
        return replace(raw, depth_m=np.linspace(first, last, height * width, dtype=np.float32).reshape(height, width))

    roles = ("rgb", "depth", "odometry")
    buffer = [seen(k, 0.78, 0.9995) for k in range(5)]
    near = [seen(k, 0.0, 0.9995) for k in range(5)]
    (tmp_path / "near").mkdir()
    assert "z-buffer" in said(imported(tmp_path, buffer, roles))
    assert "z-buffer" not in said(imported(tmp_path / "near", near, roles))
