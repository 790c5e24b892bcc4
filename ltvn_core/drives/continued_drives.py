"""Whether a drive goes on in the odometry of the drive before it, as where one recording was split into parts.

Owns the rule. A robot that is switched on again begins its odometry at zero, in a frame of the same name, so neither
the name of a frame nor a pose near the end of the drive before is enough: time, pose and frame must all agree, and the
pose must not be one at which odometry begins. A drive that goes on where its odometry had begun cannot be told from a
restart, so it counts as one.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ltvn_core.geometry import distance, relative, wrap_angle
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.recording.metadata import SOURCE_SCENE, RecordingMetadata
from ltvn_core.recording.reader import Recording
from ltvn_core.types import Pose, Waypoint

LONGEST_PAUSE_S = 120.0
"""Longest time between two drives of one odometry, in seconds."""
_STOOD_M, _STOOD_RAD = 0.5, math.radians(30)
"""A robot that moved by less than this, in metres and radians, stood still for all that a recording shows."""


def is_continued(before: Recording, after: Recording) -> bool:
    """Tell whether a drive goes on in the odometry of the one before it.

    Args:
        before: The drive that ended first.
        after: The drive that may go on in its odometry.

    Returns:
        Whether both are of one place, source and frame of odometry; the second begins within two minutes of the end of
        the first, on one clock; and its first pose is as near to the last one of the first as a robot can have come
        since, and near neither the zero of odometry nor the first pose of the first.
    """
    if not may_be_one_place(before.meta, after.meta) or not _may_be_one_frame(before.meta, after.meta):
        return False
    earlier, later = before.poses, after.poses
    if not (np.ptp(earlier.odometry, axis=0).any() and np.ptp(later.odometry, axis=0).any()):
        return False  # Odometry that stands still is none.
    pause_s = float(later.stamps[0] - earlier.stamps[-1])
    step = relative(earlier.odometry[-1], later.odometry[0])
    return _can_have_driven(step, pause_s) and not _may_be_restarted(earlier.odometry, later.odometry[0])


def may_be_one_place(one: RecordingMetadata, other: RecordingMetadata) -> bool:
    """Tell whether two recordings may be of one place by what they call it."""
    # What is imported is called after its file unless somebody named the place: two names may mean one.
    return one.scene == other.scene or (one.scene.startswith(SOURCE_SCENE) and other.scene.startswith(SOURCE_SCENE))


def _may_be_one_frame(one: RecordingMetadata, other: RecordingMetadata) -> bool:
    """Tell whether odometry is of one kind, and of one frame where both recordings name theirs."""
    here, there = _import_config(one), _import_config(other)
    named = here.get("odometry_frame"), there.get("odometry_frame")
    return here.get("odometry") == there.get("odometry") and (not all(named) or named[0] == named[1])


def _import_config(meta: RecordingMetadata) -> Mapping[str, Any]:
    found = meta.config.get("import", {})
    return found if isinstance(found, Mapping) else {}


def _can_have_driven(step: Waypoint, pause_s: float) -> bool:
    """Tell whether a robot can have come by a step (3,) in a pause; in a long one it must have stood."""
    if not 0 < pause_s <= LONGEST_PAUSE_S:
        return False
    return _is_standing(step) or (pause_s <= PAUSE_S and float(distance(step)) < JUMP_M)


def _may_be_restarted(before: Pose, pose: Pose) -> bool:
    """Tell whether odometry may have begun anew at a pose (3,), rather than gone on from poses (N, 3) before.

    What is recorded is where the camera is, which at zero may be far from the middle of the robot and look aside; then
    both drives begin there.
    """
    is_nearer_to_zero = float(distance(pose)) <= float(distance(relative(before[-1], pose)))
    return is_nearer_to_zero or _is_standing(pose) or _is_standing(relative(before[0], pose))


def _is_standing(step: Waypoint) -> bool:
    return float(np.hypot(step[0], step[1])) <= _STOOD_M and abs(float(wrap_angle(step[2]))) <= _STOOD_RAD
