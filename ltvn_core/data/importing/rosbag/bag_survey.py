"""Surveys a bag before it is read: the first messages of each relevant topic, and the robot's frames.

Owns this survey, and the extraction of stamps, poses and frames from ROS messages. No image is decoded.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np

from ltvn_core.data.importing.rosbag.bag_files import BagFiles, RawMessage
from ltvn_core.data.importing.rosbag.transform_tree import TransformTree
from ltvn_core.data.importing.spatial_pose import transform
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
)
"""Message types that hold the robot's pose."""
PATH = "nav_msgs/msg/Path"
"""Message type with many poses; it is odometry if each has a stamp of its own, as SLAM programs write it."""
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_STATIC = re.compile(r"static[^/]*$", re.IGNORECASE)
_SURVEY_S = (1.0, 20.0)
"""Length of the survey in seconds: at least the first, and at most the second value if a topic is silent."""
_MOST_STAMPS = 50
"""Number of messages of a topic whose stamps are compared with the time of recording."""
_MOST_STATIC = 1000
"""Number of messages above which a topic of fixed transforms repeats them, so that its beginning holds them all."""
_UNKNOWN_VARIANCE = 9999.0
"""Variance in square metres from which odometry says that it was lost; RTAB-Map and ZED write this number."""


@dataclass(frozen=True, slots=True)
class BagSurvey:
    """Result of reading the beginning of a bag."""

    samples: dict[str, Any] = field(default_factory=dict)
    """The first message of each topic."""
    leads_s: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    """Leads of the stamps above 0 over the times at which the messages were recorded, in seconds, by topic and, for
    transforms, by frame."""
    unstamped_s: dict[str, float] = field(default_factory=dict)
    """The same lead of the first stamp of 0, by topic."""
    lost: dict[str, bool] = field(default_factory=dict)
    """Whether all poses of a topic so far say by their covariance that they are unknown."""
    transforms: dict[str, int] = field(default_factory=dict)
    """Number of messages so far of each topic of transforms."""
    earliest_s: dict[str, float] = field(default_factory=dict)
    """The first stamp above 0 of each topic, in seconds; missing if all are 0."""
    tree: TransformTree = field(default_factory=TransformTree)
    """Frames of `/tf` and `/tf_static` so far."""

    def lead_s(self, topic: str) -> float | None:
        """Return the usual lead of a topic's stamps over the times of recording, in seconds; None if it is unknown.

        Of several frames the one that is nearest to 0 counts, because localisers date their transforms ahead.
        """
        leads = [median(each) for each in self.leads_s.get(topic, {}).values()]
        return min(leads, key=abs, default=self.unstamped_s.get(topic))

    def is_steady(self, topic: str, tolerance_s: float) -> bool:
        """Tell whether the lead of a topic's stamps changes little, so that the times of recording are real ones."""
        return all(np.ptp(each) <= tolerance_s for each in self.leads_s.get(topic, {}).values())


def survey(files: BagFiles) -> BagSurvey:
    """Read the beginning of a bag, until there is a message of each relevant topic. Raises DriveError."""
    found = BagSurvey()
    kinds = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, PATH, *POSES, *TRANSFORMS)
    topics = {topic.name for topic in files.topics.values() if topic.count and topic.msgtype in kinds}
    begin: float | None = None
    for raw in files.messages(topics):
        begin = raw.log_s if begin is None else begin
        passed = raw.log_s - begin
        if passed > _SURVEY_S[1] or (passed > _SURVEY_S[0] and topics <= found.samples.keys()):
            break
        is_new = raw.msgtype in TRANSFORMS or raw.topic not in found.earliest_s
        if is_new or (raw.msgtype != CAMERA_INFO and len(found.leads_s[raw.topic][""]) < _MOST_STAMPS):
            _take(found, raw, files.decode(raw))
    # The fixed transforms of the whole bag, because each of several nodes publishes its own when it starts.
    fixed = [topic for topic in files.topics.values() if topic.msgtype in TRANSFORMS and is_static(topic.name)]
    late = {topic.name for topic in fixed if found.transforms.get(topic.name, 0) < topic.count <= _MOST_STATIC}
    if late:
        survey_frames(files, found.tree, late)
    if any(topic.written.foxglove for topic in files.topics.values() if topic.msgtype in TRANSFORMS):
        found.tree.settle()
    return found


def survey_frames(files: BagFiles, tree: TransformTree, topics: Collection[str]) -> None:
    """Add all transforms of a bag to a tree; for a bag whose beginning does not say where its camera is. Raises
    DriveError."""
    for raw in files.messages(topics):
        add_transforms(tree, files.decode(raw), raw)


def are_all_lost(files: BagFiles, topic: str) -> bool:
    """Tell whether all poses of a topic say that they are unknown. Raises DriveError."""
    return all(is_lost(files.decode(raw)) for raw in files.messages({topic}))


def is_lost(message: Any) -> bool:
    """Tell whether a pose says by its covariance that its place is unknown: 9999 or more, or negative."""
    covariance = getattr(message.pose, "covariance", None) if hasattr(message, "pose") else None
    if covariance is None:
        return False
    x, y = float(covariance[0]), float(covariance[7])
    return max(x, y) >= _UNKNOWN_VARIANCE or min(x, y) < 0


def add_transforms(tree: TransformTree, message: Any, raw: RawMessage, *, by_log: bool = False, skip: str = "") -> None:
    """Add a message of `/tf` or `/tf_static` to the tree, except the pose of the frame `skip`.

    With `by_log`, the time of recording replaces the stamps.
    """
    for each in message.transforms:
        child = frame_name(each.child_frame_id)
        parent = frame_name(each.header.frame_id)
        pose = transform(*ros_pose(each))
        if pose is None or child == skip or not child or not parent:
            continue
        if is_static(raw.topic):
            tree.add_fixed(parent, child, pose)
        else:
            tree.add_moving(parent, child, raw.log_s if by_log else stamp_s(each), pose)


def is_static(topic: str) -> bool:
    """Tell whether a topic publishes fixed transforms: `/tf_static`, or `/static_transforms`."""
    return _STATIC.search(topic) is not None


def ros_pose(message: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return position (3,) and quaternion x, y, z, w of an odometry, pose (with or without covariance) or transform
    message."""
    if hasattr(message, "transform"):
        place = message.transform.translation
        turn = message.transform.rotation
    else:
        pose = getattr(message.pose, "pose", message.pose)
        place = pose.position
        turn = pose.orientation
    return (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)


def frame_name(name: Any) -> str:
    """Return the name of a frame without the leading slash of ROS 1."""
    return str(name).lstrip("/")


def stamp_s(message: Any) -> float:
    """Return the stamp of a message in seconds; 0 if it has none."""
    header = getattr(message, "header", None)
    return 0.0 if header is None else header.stamp.sec + header.stamp.nanosec * 1e-9


def _take(found: BagSurvey, raw: RawMessage, message: Any) -> None:
    found.samples.setdefault(raw.topic, message)
    leads = found.leads_s.setdefault(raw.topic, {})
    for each in getattr(message, "transforms", (message,)):
        stamp = stamp_s(each)
        frame = frame_name(each.child_frame_id) if raw.msgtype in TRANSFORMS else ""
        if stamp > 0:
            found.earliest_s.setdefault(raw.topic, stamp)
            leads.setdefault(frame, []).append(stamp - raw.log_s)
        else:
            found.unstamped_s.setdefault(raw.topic, stamp - raw.log_s)
    if raw.msgtype in POSES:
        found.lost[raw.topic] = found.lost.get(raw.topic, True) and is_lost(message)
    if raw.msgtype in TRANSFORMS:
        found.transforms[raw.topic] = found.transforms.get(raw.topic, 0) + 1
        add_transforms(found.tree, message, raw)
