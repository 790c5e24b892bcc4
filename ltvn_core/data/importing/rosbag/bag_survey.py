"""Surveys the beginning of a bag: one message of each relevant topic, and the robot's frames.

Owns this survey, and the extraction of stamps, poses and frames from ROS messages. No image is decoded.
"""

import re
from dataclasses import dataclass, field
from typing import Any

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
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_STATIC = re.compile(r"static[^/]*$", re.IGNORECASE)
_SURVEY_S = (1.0, 20.0)
"""Length of the survey in seconds: at least the first, and at most the second value if a topic is silent."""


@dataclass(frozen=True, slots=True)
class BagSurvey:
    """Result of reading the beginning of a bag."""

    samples: dict[str, Any] = field(default_factory=dict)
    """The first message of each topic."""
    ahead_s: dict[str, float] = field(default_factory=dict)
    """Lead of the first stamp above 0 over the time at which its message was recorded, in seconds, by topic; the first
    stamp if all are 0."""
    earliest_s: dict[str, float] = field(default_factory=dict)
    """The first stamp above 0 of each topic, in seconds; missing if all are 0."""
    tree: TransformTree = field(default_factory=TransformTree)
    """Frames of `/tf` and `/tf_static` so far."""


def survey(files: BagFiles) -> BagSurvey:
    """Read the beginning of a bag, until there is a message of each relevant topic. Raises DriveError."""
    found = BagSurvey()
    kinds = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO, *POSES, *TRANSFORMS)
    topics = {topic.name for topic in files.topics.values() if topic.count and topic.msgtype in kinds}
    begin: float | None = None
    for raw in files.messages(topics):
        begin = raw.log_s if begin is None else begin
        passed = raw.log_s - begin
        if passed > _SURVEY_S[1] or (passed > _SURVEY_S[0] and topics <= found.samples.keys()):
            break
        if raw.msgtype in TRANSFORMS or raw.topic not in found.earliest_s:
            _take(found, raw, files.decode(raw))
    if any(topic.written.foxglove for topic in files.topics.values() if topic.msgtype in TRANSFORMS):
        found.tree.settle()
    return found


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
    stamped = message if hasattr(message, "header") else next(iter(getattr(message, "transforms", ())), None)
    if stamped is not None and raw.topic not in found.earliest_s:
        stamp = stamp_s(stamped)
        if stamp > 0:
            found.earliest_s[raw.topic] = stamp
            found.ahead_s[raw.topic] = stamp - raw.log_s
        else:
            found.ahead_s.setdefault(raw.topic, stamp - raw.log_s)
    if raw.msgtype in TRANSFORMS:
        add_transforms(found.tree, message, raw)
