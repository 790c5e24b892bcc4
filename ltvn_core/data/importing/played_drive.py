"""Plays a recorded drive as a robot: images arrive at the recorded pace, regardless of commands (open loop).

Any format that can be imported can be played. A drive is named by its path, or by PROFILE@PATH, where a profile gives
the robot's topics, its size and the camera's mounting. Owns these names, the pace, opening a robot or a drive by its
name, and the check of a drive's beginning, which corresponds to the check of a robot before driving. Readers read the
files, and `frame_preparation` fits the camera.
"""

import logging
import math
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.import_options import OdometrySource, frames_with_odometry
from ltvn_core.data.importing.raw_frame import DriveReader, FrameMoment, RawFrame, ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import DriveError, ImageError
from ltvn_core.findings import Finding, findings_of
from ltvn_core.plugins import ROBOTS, find_plugins
from ltvn_core.robots.robot import Robot, WallClock
from ltvn_core.robots.robot_plugins import check_robot
from ltvn_core.robots.robot_plugins import open_robot as open_live_robot
from ltvn_core.robots.robot_report import RobotReport, TopicReport, fit_floor, robot_findings
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.robots.ros2.profile import RobotProfile, open_profile
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Observation, Pose, RobotState, Twist

_FROM_TREE = "tf"
_LOG = logging.getLogger(__name__)


class NamedDrive(NamedTuple):
    """A drive on disk, with what is known about the robot that recorded it."""

    path: Path
    profile: RobotProfile | None = None

    @classmethod
    def find(cls, wanted: str) -> Self | None:
        """Return the drive of that name; None if no such file or folder exists. Raises RobotError."""
        if Path(wanted).exists():
            return None if wanted.endswith(".py") else cls(Path(wanted))
        name, at, place = wanted.rpartition("@")
        return cls(Path(place), open_profile(name)) if at and place and Path(place).exists() else None

    def open(self) -> DriveReader:
        """Open the drive for reading, with the topics of the profile. Raises DriveError."""
        if self.profile is None:
            return open_drive(self.path)
        topics = self.profile.topics
        odometry = topics.odometry or _FROM_TREE
        named = ReadOptions(rgb=topics.colour, depth=topics.depth, odometry=odometry, camera_info=topics.camera_info)
        return open_drive(self.path, options=named)

    def mounted(self, raw: RawFrame) -> RawFrame:
        """Return a frame with the camera's mounting from the profile."""
        if self.profile is None or raw.camera is None:
            return raw
        return replace(raw, camera=self.profile.mounted(raw.camera), tilt=None)

    def spec(self, camera: CameraModel) -> RobotSpec:
        """Return the robot's specification, with `camera` as its camera; without a profile, it has the size of a
        LoCoBot."""
        unknown = replace(LOCOBOT, height_m=max(LOCOBOT.height_m, camera.height_m))
        spec = unknown if self.profile is None else self.profile.spec(camera)
        return replace(spec, name=f"{self.path.name} (recorded)", camera=camera)


def open_robot(wanted: str) -> Robot:
    """Open a robot by its name, by `path/to/file.py:factory` or by PROFILE@ADDRESS, or play a recorded drive as a
    robot.

    A drive is named by its file or folder, of any format that can be imported, or by PROFILE@PATH. One image is taken;
    the robot is not moved. Raises PluginError, RobotError and DriveError.
    """
    drive = None if wanted in find_plugins(ROBOTS) else NamedDrive.find(wanted)
    if drive is None:
        return open_live_robot(wanted)
    robot = play_drive(drive)
    check_robot(robot, wanted)
    return robot


def play_drive(drive: NamedDrive, clock: WallClock | None = None) -> "PlayedDrive":
    """Open a drive of any format that can be imported, to play it. Raises DriveError if it cannot be used."""
    try:
        return PlayedDrive(drive, clock or WallClock())
    except DriveError as error:
        raise DriveError(
            f"{error} Options are for `ltvn import`, which makes a recording of it; a robot's profile says topics and "
            "mounting here, too (PROFILE@drive.mcap)."
        ) from error


class PlayedDrive:
    """A drive as a robot. Implements `ltvn_core.robots.robot.Robot`.

    Its clock starts with the second observation: opening a robot takes one observation, and the rest of the program may
    take long to start. Whoever calls `wait` starts it by `play`. At the end the last image stays.
    """

    def __init__(self, drive: NamedDrive, clock: WallClock) -> None:
        """Play a drive. Raises DriveError where no image can be used."""
        self.clock = clock
        self._drive = drive
        self._name = drive.path.name
        reader = drive.open()
        self.open_loop = (
            f"{self._name} is a recorded drive, played back without control: it cannot be driven, so it cannot go to "
            "goals. `ltvn robot check --map` shows where the drive went."
        )
        """Reason why commands have no effect."""
        self.odometry, self._frames = self._frames_of(reader)
        """Source of its odometry, and its frames with their poses."""
        self.is_waiting = False
        """Whether the drive stands at its first image until `play`."""
        self._lock = threading.RLock()
        self._looks = 0
        self._begun_s: float | None = None
        """Time at which the clock started; None before that."""
        self._told = False
        self._observation, self._seen_s = self._first()
        self._newest: tuple[RawFrame, Pose] | None = None
        """The newest frame and its pose, until it is observed."""
        self._pose = self._observation.odometry
        self._next = next(self._frames, None)

    @property
    def spec(self) -> RobotSpec:
        """The robot's size, with the upright camera of the drive."""
        return self._drive.spec(self._preparation.camera)

    @property
    def is_over(self) -> bool:
        """Whether the last image was observed."""
        with self._lock:  # Reads no frame: `state` and `observe` do.
            return self._begun_s is not None and self._newest is None and self._next is None

    def wait(self) -> None:
        """Stand at the first image until `play`."""
        self.is_waiting = True

    def play(self) -> None:
        """Play the drive from its beginning; steps and time go on. Raises DriveError if it cannot be read any more."""
        with self._lock:
            if self._begun_s is not None:
                _, self._frames = self._frames_of(self._drive.open())
                self._newest, self._next = None, next(self._frames, None)
                if self._next is not None:
                    self._seen_s = self._next[0].stamp - self._now_s
            else:
                self._begun_s = self.clock.now()
            self.is_waiting = False

    def observe(self) -> Observation:
        """Return the latest image that is due at the recorded pace."""
        with self._lock:
            self._looks += 1
            if self._looks == 2 and not self.is_waiting:
                self._begun_s = self.clock.now()
            self._play()
            if self._newest is not None:
                raw, pose = self._newest
                self._newest = None
                step = max(self._observation.step + 1, int((raw.stamp - self._seen_s) / CONTROL_STEP_S))
                try:
                    self._observation = self._prepared(raw, pose, step=step, begun_s=self._seen_s)
                except ImageError as error:
                    _LOG.warning("An image was left out: %s", error)
            return self._observation

    def state(self) -> RobotState:
        """Return the recorded odometry; the bumper is not known."""
        with self._lock:
            self._play()
            step = max(self._observation.step, int(self._now_s / CONTROL_STEP_S))
            return RobotState(self._pose, self._now_s, step, bumper_pressed=False)

    def drive(self, twist: Twist) -> None:
        """Ignore the command; log this once."""
        if not self._told and twist != ZERO_TWIST:
            self._told = True
            _LOG.warning(self.open_loop)

    def stop(self) -> None:
        """Do nothing, because the drive cannot be stopped."""

    @property
    def _now_s(self) -> float:
        """Seconds since the first image."""
        return 0.0 if self._begun_s is None else self.clock.now() - self._begun_s

    def _frames_of(self, reader: DriveReader) -> tuple[OdometrySource, Iterator[tuple[RawFrame, Pose]]]:
        source, frames = frames_with_odometry(reader)
        posed = ((raw, source.pose(FrameMoment.of(raw))) for raw in frames)
        return source, ((self._drive.mounted(raw), pose) for raw, pose in posed if pose is not None)

    def _first(self) -> tuple[Observation, float]:
        """Return the first usable image and its stamp, and set up the preparation of frames."""
        fault = ""
        for raw, pose in self._frames:
            try:
                self._preparation = FramePreparation(raw)
                return self._prepared(raw, pose, step=0, begun_s=raw.stamp), raw.stamp
            except ImageError as error:
                fault = fault or f" {error}"
        raise DriveError(f"None of the images of {self._name} can be used.{fault}")

    def _play(self) -> None:
        """Read the frames that are due, and keep the newest."""
        while self._next is not None and self._next[0].stamp - self._seen_s <= self._now_s:
            self._newest = self._next
            self._pose = self._next[1]
            self._next = next(self._frames, None)
            if self._next is None:
                _LOG.info("%s is over; its last image stays.", self._name)

    def _prepared(self, raw: RawFrame, pose: Pose, *, step: int, begun_s: float) -> Observation:
        prepared = self._preparation.observation(raw, step=step, odometry=pose)
        return replace(prepared, stamp=raw.stamp - begun_s, exact_pose=None)


def look_over_drive(drive: NamedDrive, *, seconds: float) -> RobotReport:
    """Check the first seconds of a drive, and its first image. Raises DriveError where it cannot be used."""
    robot = play_drive(drive)
    camera = robot.spec.camera
    seen = robot.observe()
    reader = drive.open()
    stamps: list[float] = []
    for raw in reader.frames():
        stamps.append(raw.stamp)
        if raw.stamp - stamps[0] >= seconds:
            break
    gap_s = float(np.diff(stamps).max()) if len(stamps) > 1 else None
    found: list[Finding] = []
    if robot.odometry is OdometrySource.NONE:
        found.append(Finding("It has no odometry: every image seems to be taken at one place."))
    if reader.dropped:
        counts = ", ".join(f"{count} with {reason}" for reason, count in reader.dropped.items())
        found.append(Finding(f"Left out: {counts}."))
    report = RobotReport(
        robot=robot.spec.name,
        address="",
        topics=tuple(  # Those in use; for images with the longest gap in the first seconds.
            TopicReport(stream.name, stream.rate_hz, gap_s if stream.role == "rgb" else None, ())
            for stream in reader.facts.streams
            if stream.role in ("rgb", "depth", "odometry") and stream.rate_hz is not None
        ),
        image=f"{camera.width} x {camera.height}",
        field_of_view_deg=(math.degrees(camera.horizontal_fov_rad), math.degrees(camera.vertical_fov_rad)),
        depth_share=0.0 if seen.depth is None else float(np.mean(seen.depth > 0)),
        age_s=None,
        floor=None if seen.depth is None or camera.height_m == 0 else fit_floor(seen.depth, camera),
        commands_taken=False,
        driving=None,
    )
    return replace(report, findings=(*robot_findings(report), *found, *findings_of(reader.doubts)))
