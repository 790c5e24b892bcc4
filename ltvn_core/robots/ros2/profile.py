"""Profile of a robot of ROS 2: its topics, body, limits and the mounting of its camera.

A profile is a TOML file. Shipped profiles have names; a profile of your own is given by its path. Owns the reading and
the check of every field. Connects to no robot.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.resources import files
from operator import attrgetter
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.errors import RobotError
from ltvn_core.robots.robot_spec import AccelerationLimits, RobotSpec, SpeedLimits
from ltvn_core.structured_text import parse_toml
from ltvn_core.terminal_text import which_name

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_FRAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/-]*")
_OPTIONAL = ("topics.odometry", "topics.battery", "topics.bumper", "topics.truth")
_ALLOWED: Mapping[str, tuple[float, float]] = {
    "domain": (0, 232),
    "body.radius_m": (0.01, 10),
    "body.height_m": (0.01, 10),
    "body.ground_clearance_m": (0, 1),
    "camera.height_m": (0, 10),
    "camera.pitch_deg": (-89, 89),
    "camera.roll_deg": (-180, 180),
    "camera.quarter_turns": (0, 3),
    "camera.depth_unit_m": (1e-6, 1),
    "speeds.linear_m_s": (0.01, 10),
    "speeds.angular_rad_s": (0.01, 10),
    "speeds.turning_radius_m": (0, 100),
    "accelerations.linear_m_s2": (0.01, 100),
    "accelerations.angular_rad_s2": (0.01, 100),
    "accelerations.linear_braking_m_s2": (0.01, 100),
    "accelerations.angular_braking_rad_s2": (0.01, 100),
}
"""Least and greatest value of each number of a profile. NaN is refused too, because all comparisons with it are
false."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Names of the topics of sensors and commands."""

    colour: str
    """sensor_msgs/Image, or CompressedImage with `camera.compressed_colour`."""
    depth: str
    """sensor_msgs/Image, aligned with the colours: 16UC1, or 32FC1 in metres; CompressedImage with
    `camera.compressed_depth`."""
    camera_info: str
    """sensor_msgs/CameraInfo of the colours."""
    command: str
    """geometry_msgs/Twist or TwistStamped, the drive command."""
    odometry: str = ""
    """nav_msgs/Odometry; empty if `odometry_transform` is used instead."""
    battery: str = ""
    """sensor_msgs/BatteryState; empty if there is none."""
    bumper: str = ""
    """std_msgs/Bool, whether the bumper is in contact; empty if there is none."""
    truth: str = ""
    """nav_msgs/Odometry with the true pose, from motion capture or a simulator, to evaluate runs; empty if there is
    none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryTransform:
    """Two frames of the tf tree that give the robot's odometry pose, in place of an odometry topic."""

    topic: str = "/tf"
    """tf2_msgs/TFMessage; may have several publishers."""
    parent: str = "odom"
    """The fixed frame at the robot's start."""
    child: str = "base_link"
    """The robot's own frame, a child of `parent` in the tree."""

    def __post_init__(self) -> None:
        """Check the names."""
        for field_name in ("parent", "child"):
            frame = getattr(self, field_name)
            if not _FRAME.fullmatch(frame):
                raise RobotError(f"odometry_transform.{field_name} is {frame!r:.60}; write a frame like base_link.")
        if self.parent == self.child:
            raise RobotError(f"odometry_transform has {self.parent} as both parent and child.")


@dataclass(frozen=True, slots=True, kw_only=True)
class Driving:
    """Path of commands to the wheels."""

    stamped: bool
    """Whether commands are TwistStamped, as since ROS 2 Kilted (TurtleBot 4 and others since Jazzy), and not Twist."""
    guarded: bool = True
    """Whether commands go to `guard_topic`, from which `ltvn guard` on the robot forwards the fresh ones."""
    guard_topic: str = "/ltvn/cmd_vel"
    """Topic that the guard subscribes to; at this topic + `_status` it publishes whether it forwards commands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """Size of the robot's body."""

    radius_m: float
    """Radius of the circle around the turning point that contains the body."""
    height_m: float
    """Height of the body."""
    ground_clearance_m: float
    """Height of obstacles that the robot drives over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mounting:
    """Mounting of the camera, and properties of its images that the messages lack."""

    height_m: float
    """Height of the optical centre above the floor."""
    pitch_deg: float = 0.0
    """Tilt of the optical axis, upwards positive."""
    roll_deg: float = 0.0
    """Turn about the optical axis; positive lowers the camera's right side."""
    quarter_turns: int = 0
    """Number of turns by 90 degrees counter-clockwise that make the image upright."""
    rectified: bool = False
    """Whether images are rectified already, so that only P of CameraInfo applies."""
    depth_unit_m: float = MILLIMETRES
    """Metres per unit of a 16UC1 depth image."""
    compressed_colour: bool = False
    """Whether colours are sensor_msgs/CompressedImage (JPEG or PNG), as at /camera/color/image_raw/compressed."""
    compressed_depth: bool = False
    """Whether depth is sensor_msgs/CompressedImage (PNG or RVL), as at /camera/depth/image_raw/compressedDepth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotProfile:
    """Profile of one robot model. Raises RobotError if a field is invalid."""

    name: str
    """Name of the robot for people."""
    topics: Topics
    driving: Driving
    body: Body
    camera: Mounting
    speeds: SpeedLimits = field(default_factory=SpeedLimits)
    accelerations: AccelerationLimits = field(default_factory=AccelerationLimits)
    odometry_transform: OdometryTransform | None = None
    """Frames of the robot's odometry pose; None if `topics.odometry` is used."""
    domain: int = 0
    """The robot's ROS_DOMAIN_ID."""

    @property
    def odometry_topic(self) -> str:
        """Topic of the robot's odometry."""
        return self.topics.odometry if self.odometry_transform is None else self.odometry_transform.topic

    def __post_init__(self) -> None:
        """Check the fields beyond their types."""
        named = {f"topics.{each.name}": getattr(self.topics, each.name) for each in fields(self.topics)}
        named["driving.guard_topic"] = self.driving.guard_topic
        if self.odometry_transform is not None:
            named["odometry_transform.topic"] = self.odometry_transform.topic
        if bool(self.topics.odometry) == (self.odometry_transform is not None):
            raise RobotError("either topics.odometry or the table odometry_transform gives the robot's pose, not both.")
        for place, topic in named.items():
            if not _TOPIC.fullmatch(topic) and (topic or place not in _OPTIONAL):
                raise RobotError(f"{place} is {topic!r:.60}; write a topic like /camera/color/image_raw.")
        if self.driving.guard_topic == self.topics.command:
            raise RobotError("driving.guard_topic equals topics.command, so the guard would receive its own commands.")
        values = {name: attrgetter(name)(self) for name in _ALLOWED}
        wrong = [
            f"{name} is {values[name]}; it must be from {least:g} to {most:g}"
            for name, (least, most) in _ALLOWED.items()
            if not least <= values[name] <= most
        ]
        if wrong:
            raise RobotError(f"{'; '.join(wrong)}.")
        self.spec(CameraModel.from_fov(64, 48, 1.0))  # The checks of `RobotSpec` cover the relations between sizes.

    def spec(self, lens: CameraModel) -> RobotSpec:
        """Return the robot's properties, with the lens that the robot published."""
        return RobotSpec(
            name=self.name,
            radius_m=self.body.radius_m,
            height_m=self.body.height_m,
            ground_clearance_m=self.body.ground_clearance_m,
            camera=self.mounted(lens),
            speeds=self.speeds,
            accelerations=self.accelerations,
        )

    def mounted(self, lens: CameraModel) -> CameraModel:
        """Return the camera with a lens and this mounting. Its depth is in metres, as messages are decoded."""
        return CameraModel.from_json(
            {
                **lens.to_json(),
                "height_m": self.camera.height_m,
                "pitch_rad": math.radians(self.camera.pitch_deg),
                "roll_rad": math.radians(self.camera.roll_deg),
                "quarter_turns": self.camera.quarter_turns,
                "depth_scale": 1.0,
            }
        )


def shipped_profiles() -> dict[str, str]:
    """Return the text of each shipped profile by name."""
    folder = files("ltvn_core.robots.ros2") / "profiles"
    texts = {each.name.removesuffix(".toml"): each for each in folder.iterdir() if each.name.endswith(".toml")}
    return {name: texts[name].read_text(encoding="utf-8") for name in sorted(texts)}


def open_profile(wanted: str) -> RobotProfile:
    """Return a shipped profile by name, or a profile from a TOML file. Raises RobotError."""
    if wanted.endswith(".toml"):
        try:
            text = Path(wanted).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RobotError(f"The profile {wanted} cannot be read: {error}.") from error
        return read_profile(text, wanted)
    known = shipped_profiles()
    if wanted not in known:
        raise RobotError(
            f"No robot profile is called {wanted!r:.60}. {which_name(wanted, known)}; name your own profile by its "
            "path, such as my_robot.toml."
        )
    return read_profile(known[wanted], wanted)


def read_profile(text: str, source: str) -> RobotProfile:
    """Return the profile in a TOML text. Raises RobotError with the names of all invalid fields."""
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise RobotError(f"The profile {source} is not TOML: {error}.") from error
    try:
        return _converter().structure(tables, RobotProfile)
    except cattrs.BaseValidationError as error:
        wrong = "; ".join(
            each.replace("$.", "").replace("$", "the file")
            for each in cattrs.transform_error(error, format_exception=_words)
        )
        raise RobotError(
            f"The profile {source} cannot be used: {wrong}. docs/how-to/ros2-robot.md lists the fields."
        ) from error


@cache
def _converter() -> cattrs.Converter:
    """Return a strict converter, which rejects unknown fields and wrong types."""
    converter = cattrs.Converter(forbid_extra_keys=True)
    for kind in (float, int, bool, str):
        converter.register_structure_hook(kind, _strict)
    return converter


def _strict(value: Any, kind: type) -> Any:
    fits = isinstance(value, (int, float) if kind is float else kind) and (kind is bool) == isinstance(value, bool)
    if not fits:
        raise ValueError(f"expected {_KINDS[kind]}, got {value!r:.60}")
    return kind(value)


_KINDS = {float: "a number", int: "a whole number", bool: "true or false", str: "text in quotes"}


def _words(error: BaseException, _: type | None) -> str:
    """Return the error of a field in words."""
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        return f"there is no field {', '.join(sorted(error.extra_fields))}"
    if isinstance(error, KeyError):
        return "a field is missing"
    return str(error).rstrip(".")
