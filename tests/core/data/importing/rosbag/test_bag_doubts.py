"""What a bag says in an unusual way is understood: lost odometry, frames with z down, late frames, other clocks."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.core.data.importing.rosbag.bag_examples import (
    BEGIN_S,
    COLOUR_FRAME,
    BagBuilder,
    Place,
    bag,
    colours,
    mounted,
    planar,
    straight_drive,
)
from tests.core.data.importing.rosbag.test_rosbag_reader import COLOURS, read

Odometry = Callable[[BagBuilder, int, float], None]


def circling_drive(path: Path, odometry: Odometry, *, mounting: bool = True, lost: range = range(0)) -> Path:
    """Write images at 5 Hz for 4 s, with odometry at 20 Hz by `odometry`, except in the ticks `lost`."""
    with bag(path) as builder:
        if mounting:
            builder.transforms("/tf_static", {("base_link", COLOUR_FRAME): mounted(x=0.0)}, BEGIN_S)
        for tick in range(84):
            stamp = BEGIN_S + 0.05 * tick
            if tick not in lost:
                odometry(builder, tick, stamp)
            if tick % 4 == 0 and tick < 80:
                builder.image(COLOURS, colours(tick // 4 % 9), "rgb8", stamp)
    return path


def at(tick: int) -> Place:
    return planar(0.02 * tick, 0.01 * tick, 0.03 * tick)


def usual(builder: BagBuilder, tick: int, stamp: float) -> None:
    builder.odometry("/odom", at(tick), stamp, child="base_link")


def test_odometry_that_was_silent_is_told_with_the_time(tmp_path: Path) -> None:
    frames, reader = read(circling_drive(tmp_path / "drive", usual, lost=range(25, 65)))

    assert reader.dropped == {"no pose at that time": 10}
    assert len(frames) == 10
    (doubt,) = reader.doubts
    assert "10 images from 1.4 s to 3.2 s" in doubt
    assert "silent for 2.0 s" in doubt


@pytest.mark.parametrize(
    ("variance", "place", "said"),
    [
        (9999.0, None, "covariance"),
        (-1.0, None, "covariance"),
        (0.0, Place((np.nan, 0.0, 0.0)), "not finite"),
        (0.0, "null", "null"),
    ],
)
def test_odometry_that_says_that_it_is_lost_gives_no_pose(
    tmp_path: Path, variance: float, place: Place | str | None, said: str
) -> None:
    def odometry(builder: BagBuilder, tick: int, stamp: float) -> None:
        is_lost = 25 <= tick < 65
        where = at(24) if place is None else place
        builder.odometry(
            "/odom",
            where if is_lost and isinstance(where, Place) else at(tick),
            stamp,
            child="base_link",
            variance=variance if is_lost else 0.01,
            is_null=is_lost and place == "null",
        )

    frames, reader = read(circling_drive(tmp_path / "drive", odometry))

    assert reader.dropped == {"no pose at that time": 10}
    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(
        [0.02 * tick for tick in (0, 4, 8, 12, 16, 20, 24, 68, 72, 76)], abs=1e-6
    )
    (doubt,) = reader.doubts
    assert "10 images from 1.4 s to 3.2 s" in doubt
    assert said in doubt


def test_a_covariance_that_says_the_same_of_every_pose_is_doubted_and_the_poses_are_used(tmp_path: Path) -> None:
    def odometry(builder: BagBuilder, tick: int, stamp: float) -> None:
        builder.odometry("/odom", at(tick), stamp, child="base_link", variance=1e5)

    frames, reader = read(circling_drive(tmp_path / "drive", odometry))

    assert len(frames) == 20
    assert "covariance" in reader.doubts[0]


@pytest.mark.parametrize("frames_of", ["without the body", "with the body", "only the body"])
def test_odometry_in_frames_with_z_down_becomes_a_pose_with_z_up(tmp_path: Path, frames_of: str) -> None:
    turned = Rotation.from_euler("x", np.pi)

    def odometry(builder: BagBuilder, tick: int, stamp: float) -> None:
        x, y, _ = at(tick).xyz
        down = Place((x, -y, 0.0), Rotation.from_euler("z", -0.03 * tick))
        builder.odometry("/odom", down, stamp, parent="odom_ned", child="base_link_frd")

    with bag(tmp_path / "drive") as builder:
        camera = mounted(x=0.0)
        if frames_of == "only the body":
            below = Place((0.0, 0.0, -0.6), turned * camera.turn)
            builder.transforms("/tf_static", {("base_link_frd", COLOUR_FRAME): below}, BEGIN_S)
        else:
            static = {("base_link", COLOUR_FRAME): camera}
            body = {("base_link", "base_link_frd"): Place(turn=turned)} if frames_of == "with the body" else {}
            builder.transforms("/tf_static", {**body, **static}, BEGIN_S)
        for tick in range(40):
            odometry(builder, tick, BEGIN_S + 0.05 * tick)
            if tick % 4 == 0:
                builder.image(COLOURS, colours(tick // 4 % 9), "rgb8", BEGIN_S + 0.05 * tick)
                builder.camera_info("/camera/color/camera_info", BEGIN_S + 0.05 * tick)

    frames, reader = read(tmp_path / "drive")

    assert len(frames) == 10
    for number, frame in enumerate(frames):
        assert frame.odometry == pytest.approx([0.08 * number, 0.04 * number, 0.12 * number], abs=1e-6)
        assert frame.camera is not None
        assert frame.camera.height_m == pytest.approx(0.6)
        assert frame.camera.pitch_rad == pytest.approx(-0.2)
        assert frame.camera.quarter_turns == 0
    assert reader.facts.odometry_frame == "odom"
    assert not reader.doubts


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_the_cameras_place_is_found_wherever_in_the_bag_it_is_said(tmp_path: Path, topic: str) -> None:
    with bag(tmp_path / "drive") as builder:
        builder.transforms("/tf_static", {("base_link", "imu"): Place()}, BEGIN_S)
        for tick in range(84):
            stamp = BEGIN_S + 0.05 * tick
            usual(builder, tick, stamp)
            if tick == 60 or (topic == "/tf" and tick > 60):
                builder.transforms(topic, {("base_link", COLOUR_FRAME): mounted(x=0.0)}, stamp)
            if tick % 4 == 0 and tick < 80:
                builder.image(COLOURS, colours(tick // 4 % 9), "rgb8", stamp)
                builder.camera_info("/camera/color/camera_info", stamp)

    frames, reader = read(tmp_path / "drive")

    assert len(frames) == 20
    assert {frame.camera and round(frame.camera.height_m, 3) for frame in frames} == {0.6}
    assert {frame.camera and round(frame.camera.pitch_rad, 3) for frame in frames} == {-0.2}
    assert not reader.doubts


@pytest.mark.parametrize("offset_s", [2.0, 0.5, -3.0])
def test_odometry_with_stamps_of_another_clock_is_taken_by_the_time_of_recording(
    tmp_path: Path, offset_s: float
) -> None:
    def odometry(builder: BagBuilder, tick: int, stamp: float) -> None:
        builder.odometry("/odom", at(tick), stamp + offset_s, child="base_link", log_s=stamp)

    frames, reader = read(circling_drive(tmp_path / "drive", odometry))

    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(
        0.08 * np.arange(20), abs=1e-6
    )
    (doubt,) = reader.doubts
    assert "time of recording" in doubt


def test_messages_that_came_late_but_by_one_clock_keep_their_stamps_and_that_is_told(tmp_path: Path) -> None:
    def odometry(builder: BagBuilder, tick: int, stamp: float) -> None:
        builder.odometry("/odom", at(tick), stamp, child="base_link", log_s=stamp + 0.5)

    frames, reader = read(circling_drive(tmp_path / "drive", odometry))

    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(
        0.08 * np.arange(20), abs=1e-6
    )
    (doubt,) = reader.doubts
    assert "/odom is late" in doubt


def test_messages_that_a_killed_recorder_left_beside_its_file_are_read(tmp_path: Path) -> None:
    whole = next(straight_drive(tmp_path / "whole", "sqlite3").glob("*.db3"))
    work = tmp_path / "work.db3"
    shutil.copy(whole, work)
    killed = tmp_path / "killed"
    killed.mkdir()
    with closing(sqlite3.connect(work)) as database:
        rows = database.execute("SELECT id, topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        database.execute("DELETE FROM messages WHERE id > 10")
        database.commit()
        database.execute("PRAGMA journal_mode = wal")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        database.executemany("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows[10:])
        database.commit()
        for ending in ("", "-wal"):
            shutil.copy(f"{work}{ending}", killed / f"bag_0.db3{ending}")
    before = {each.name: each.read_bytes() for each in killed.iterdir()}

    frames, reader = read(killed)

    assert [frame.odometry[0] for frame in frames if frame.odometry is not None] == pytest.approx(
        [0.15, 0.25, 0.35, 0.45, 0.55, 0.65]
    )
    assert "ended before" in reader.doubts[0]
    assert {each.name: each.read_bytes() for each in killed.iterdir()} == before
