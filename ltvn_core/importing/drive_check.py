"""Looks the beginning of a recorded drive over, as a robot is looked over before anybody drives it."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ltvn_core.findings import Finding, findings_of
from ltvn_core.importing.drive_odometry import OdometrySource, chosen_odometry
from ltvn_core.importing.named_drive import NamedDrive
from ltvn_core.importing.played_drive import play_drive
from ltvn_core.importing.raw_frame import DriveReader
from ltvn_core.robots.floor_fit import fit_floor
from ltvn_core.robots.robot_check import RobotReport, TopicReport, robot_findings


def look_over_drive(drive: NamedDrive, *, seconds: float) -> RobotReport:
    """Look at the first seconds of a drive, and at its first image. Raises DriveError where it cannot be used."""
    robot = play_drive(drive)
    camera = robot.spec.camera
    seen = robot.observe()
    reader = drive.open()
    report = RobotReport(
        robot=robot.spec.name,
        address="",
        topics=_watch(reader, seconds),
        image=f"{camera.width} x {camera.height}",
        field_of_view_deg=(math.degrees(camera.horizontal_fov_rad), math.degrees(camera.vertical_fov_rad)),
        depth_share=0.0 if seen.depth is None else float(np.mean(seen.depth > 0)),
        age_s=None,
        floor=None if seen.depth is None or camera.height_m == 0 else fit_floor(seen.depth, camera),
        commands_taken=False,
        driving=None,
    )
    return replace(report, findings=(*robot_findings(report), *_findings(reader), *findings_of(reader.doubts)))


def _watch(reader: DriveReader, seconds: float) -> tuple[TopicReport, ...]:
    """Return what the streams in use do; of images also the longest gap in the first seconds."""
    stamps: list[float] = []
    for raw in reader.frames():
        stamps.append(raw.stamp)
        if raw.stamp - stamps[0] >= seconds:
            break
    gap_s = float(np.diff(stamps).max()) if len(stamps) > 1 else None
    return tuple(
        TopicReport(stream.name, stream.rate_hz, gap_s if stream.role == "rgb" else None, ())
        for stream in reader.facts.streams
        if stream.role in ("rgb", "depth", "odometry") and stream.rate_hz is not None
    )


def _findings(reader: DriveReader) -> Iterator[Finding]:
    if chosen_odometry(reader) is OdometrySource.NONE:
        yield Finding("It has no odometry: every image seems to be taken at one place.")
    if reader.dropped:
        counts = ", ".join(f"{count} with {reason}" for reason, count in reader.dropped.items())
        yield Finding(f"Left out: {counts}.")
