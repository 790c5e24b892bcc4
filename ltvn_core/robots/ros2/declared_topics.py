"""Compares a robot's profile with the topics that its nodes declare, and names the lines of the profile to change."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ltvn_core.findings import Finding
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.robot_sensors import colour_topic, depth_topic, odometry_topic
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.robots.ros2.topic_keys import (
    BATTERY,
    BUMPER,
    ODOMETRY,
    TWIST,
    TWIST_STAMPED,
    Declared,
    Role,
    Topic,
    command_type,
)

_TYPE_LINES = {
    ("topics.command", TWIST): "driving.stamped = false",
    ("topics.command", TWIST_STAMPED): "driving.stamped = true",
    ("topics.colour", IMAGE): "camera.compressed_colour = false",
    ("topics.colour", COMPRESSED_IMAGE): "camera.compressed_colour = true",
    ("topics.depth", IMAGE): "camera.compressed_depth = false",
    ("topics.depth", COMPRESSED_IMAGE): "camera.compressed_depth = true",
}
"""Line of the profile that selects another type of a topic."""


class _Wanted(NamedTuple):
    """A topic in the robot's profile."""

    line: str
    """Name of the topic's field in the profile."""
    topic: Topic
    role: Role = Role.PUBLISHES
    """Whether the robot publishes the topic or subscribes to it."""


def declared_otherwise(profile: RobotProfile, declared: Iterable[Declared]) -> Iterator[Finding]:
    """Yield a finding for topics of the profile that no node declares, with the lines of the profile to change.

    Only topics that are similar to a declared one are reported.
    """
    everything = list(declared)
    names: dict[str, list[str]] = {}
    for wanted in _wanted(profile):
        found = [each for each in everything if each.role is wanted.role]
        if not any(map(wanted.topic.fits, found)) and (lines := _fewest_changes(wanted, found)):
            names.setdefault(lines, []).append(wanted.topic.name)
    for lines, topics in names.items():
        text = f"The robot does not declare {', '.join(topics)} as in the profile."
        yield Finding(text, remedy=f"Change the profile: {lines}.", where=topics[0] if len(topics) == 1 else "")


def _fewest_changes(wanted: _Wanted, found: Iterable[Declared]) -> str:
    """Return the smallest set of lines to change, or all sets of that size; empty if no declared topic is similar."""
    possible = [lines for each in found if (lines := _changes(wanted, each))]
    fewest = min(map(len, possible), default=0)
    return "; or ".join(sorted({", ".join(lines) for lines in possible if len(lines) == fewest}))


def _wanted(profile: RobotProfile) -> Iterator[_Wanted]:
    topics, domain = profile.topics, profile.domain
    yield _Wanted("topics.colour", colour_topic(profile))
    yield _Wanted("topics.depth", depth_topic(profile))
    yield _Wanted("topics.camera_info", Topic(topics.camera_info, CAMERA_INFO, domain))
    place = "topics.odometry" if profile.odometry_transform is None else "odometry_transform.topic"
    yield _Wanted(place, odometry_topic(profile))
    for name, kind in (("battery", BATTERY), ("bumper", BUMPER), ("truth", ODOMETRY)):
        if topic := getattr(topics, name):
            yield _Wanted(f"topics.{name}", Topic(topic, kind, domain))
    command = command_type(stamped=profile.driving.stamped)
    yield _Wanted("topics.command", Topic(topics.command, command, domain), Role.SUBSCRIBES)


def _changes(wanted: _Wanted, found: Declared) -> list[str]:
    """Return the lines to change so that a topic of the profile matches a declared one; empty for another topic."""
    topic = wanted.topic
    type_line = _TYPE_LINES.get((wanted.line, found.type_name))
    if not _alike(topic.name, found.name) or (found.type_name != topic.type_name and type_line is None):
        return []
    lines = [] if found.domain == str(topic.domain) else [f"domain = {found.domain}"]
    lines += [] if found.name == topic.name else [f'{wanted.line} = "{found.name}"']
    return lines if found.type_name == topic.type_name else [*lines, str(type_line)]


def _alike(one: str, other: str) -> bool:
    """Tell whether two topic names are equal apart from their namespace."""
    tails = {name.split("/", 2)[-1] for name in (one, other)}
    return one.endswith(other) or other.endswith(one) or len(tails) == 1
