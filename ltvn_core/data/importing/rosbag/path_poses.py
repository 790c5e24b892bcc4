"""Poses of a `nav_msgs/msg/Path`, in which SLAM programs publish the whole trajectory again and again.

Owns which messages of such a topic are decoded, because each of them repeats the ones before.
"""

from collections.abc import Sequence
from itertools import chain, pairwise
from typing import Any

from ltvn_core.data.importing.rosbag.bag_files import BagFiles
from ltvn_core.data.importing.rosbag.bag_survey import ros_pose, stamp_s
from ltvn_core.data.importing.spatial_pose import Transform, transform
from ltvn_core.errors import DriveError


def has_own_stamps(message: Any) -> bool:
    """Tell whether the poses of a path may have stamps of their own; planned paths have not. True for other
    messages."""
    poses = getattr(message, "poses", ())
    return len(poses) < 2 or len({stamp_s(pose) for pose in poses}) > 1


def path_poses(files: BagFiles, topic: str) -> Sequence[tuple[float, Transform]]:
    """Return stamps in seconds and poses (4, 4) of a topic of paths, by increasing stamps; later messages correct
    earlier ones.

    Raises DriveError if the bag is damaged, or the poses have no stamps of their own.
    """
    found: dict[float, Transform] = {}
    # The last message, and each one after which the path did not grow: its begin was cut off.
    pairs = pairwise(chain(files.messages({topic}), [None]))
    for raw in (raw for raw, after in pairs if raw is not None and (after is None or len(after.data) <= len(raw.data))):
        message = files.decode(raw)
        if not has_own_stamps(message):
            raise DriveError(
                f"{files.path}: the poses of {topic} have no stamps of their own, so it is a plan, not a trajectory; "
                "name another topic with --odometry, or none."
            )
        posed = ((stamp_s(pose), transform(*ros_pose(pose))) for pose in message.poses)
        found |= {stamp: pose for stamp, pose in posed if pose is not None and stamp > 0}
    return sorted(found.items(), key=lambda item: item[0])
