"""Recordings of several drives as the images of one map: with unique numbers, on one clock, for one camera.

Owns the numbers and times of the images, which must differ between drives. Their odometry is not changed;
`is_continued` decides whether it continues from one drive to the next.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.cameras.rectification import have_same_rays
from ltvn_core.data.recording.metadata import SOURCE_SCENE, RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import MapError
from ltvn_core.findings import Finding
from ltvn_core.geometry import distance, relative, wrap_angle
from ltvn_core.graph.odometry_gate import JUMP_M, PAUSE_S
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.preprocessing import recorded_observation
from ltvn_core.types import FrameId, Observation, Pose, Waypoint

LONGEST_PAUSE_S = 120.0
"""Longest pause between two drives that share one odometry, in seconds."""
_STOOD_M, _STOOD_RAD = 0.5, math.radians(30)
"""Motion, in metres and radians, up to which a robot counts as standing still between two recordings."""


def is_continued(before: Recording, after: Recording) -> bool:
    """Tell whether a drive continues the odometry of the one before it.

    Args:
        before: The drive that ended first.
        after: The drive that may continue its odometry.

    Returns:
        True if all of these hold: both drives are of one place, one source and one frame of odometry. The second begins
        within two minutes of the end of the first, on the same clock. A robot can have moved from the last pose of the
        first to the first pose of the second in that time. The second does not begin near the zero of odometry, nor
        near the first pose of the first.
    """
    if not may_be_one_place(before.meta, after.meta) or not _may_be_one_frame(before.meta, after.meta):
        return False
    earlier = before.poses
    later = after.poses
    if not (np.ptp(earlier.odometry, axis=0).any() and np.ptp(later.odometry, axis=0).any()):
        return False  # Odometry that never changes is no odometry.
    pause_s = float(later.stamps[0] - earlier.stamps[-1])
    step = relative(earlier.odometry[-1], later.odometry[0])
    return _can_have_driven(step, pause_s) and not _may_be_restarted(earlier.odometry, later.odometry[0])


def may_be_one_place(one: RecordingMetadata, other: RecordingMetadata) -> bool:
    """Tell by the names of their places whether two recordings may be of one place."""
    # Imports are named after their files unless the place was named, so two names may mean one place.
    return one.scene == other.scene or (one.scene.startswith(SOURCE_SCENE) and other.scene.startswith(SOURCE_SCENE))


def _may_be_one_frame(one: RecordingMetadata, other: RecordingMetadata) -> bool:
    """Tell whether the odometry of two recordings is of one kind, and in one frame if both name their frames."""
    here = _import_config(one)
    there = _import_config(other)
    named = here.get("odometry_frame"), there.get("odometry_frame")
    return here.get("odometry") == there.get("odometry") and (not all(named) or named[0] == named[1])


def _import_config(meta: RecordingMetadata) -> Mapping[str, Any]:
    found = meta.config.get("import", {})
    return found if isinstance(found, Mapping) else {}


def _can_have_driven(step: Waypoint, pause_s: float) -> bool:
    """Tell whether a robot can have moved by a step (3,) in a pause; in a long pause it must have stood still."""
    if not 0 < pause_s <= LONGEST_PAUSE_S:
        return False
    return _is_standing(step) or (pause_s <= PAUSE_S and float(distance(step)) < JUMP_M)


def _may_be_restarted(before: Pose, pose: Pose) -> bool:
    """Tell whether odometry may have restarted at a pose (3,), rather than continued from poses (N, 3) before.

    The recorded pose is the camera's. At the zero of odometry the camera may be far from the middle of the robot and
    look aside; then both drives start at that pose.
    """
    is_nearer_to_zero = float(distance(pose)) <= float(distance(relative(before[-1], pose)))
    return is_nearer_to_zero or _is_standing(pose) or _is_standing(relative(before[0], pose))


def _is_standing(step: Waypoint) -> bool:
    return float(np.hypot(step[0], step[1])) <= _STOOD_M and abs(float(wrap_angle(step[2]))) <= _STOOD_RAD


_PAUSE_S = 60.0
"""Least pause assumed between two drives if nothing more is known, in seconds."""
_ROUND = 1000
"""The numbers of a later drive's images are raised by a multiple of this, so that a person still recognises them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinedDrive:
    """One of several drives."""

    name: str
    first: FrameId
    """Frame id of its first image in the map."""
    last: FrameId
    """Frame id of its last image in the map."""
    added_steps: int = 0
    """Number that was added to the steps of its recording."""
    continues: str = ""
    """Name of the drive before it whose odometry it continues; empty if its odometry restarts."""
    world_offset_s: float = 0.0
    """Seconds to add to a stamp in the map to get the time of the world; 0 if its recording does not contain that
    time."""

    def holds(self, frame: FrameId) -> bool:
        """Tell whether an image is of this drive."""
        return self.first <= frame <= self.last


@dataclass(frozen=True, slots=True, eq=False)
class JoinedDrives:
    """The images of all drives."""

    observations: list[Observation]
    """The observations in order, as the camera of the first drive would have taken them."""
    drives: tuple[JoinedDrive, ...]
    """The drives; empty if there is only one."""
    findings: tuple[Finding, ...]
    """Notes for the user."""


def join_drives(recordings: Sequence[Recording]) -> JoinedDrives:
    """Read the images of one or more recordings; the first keeps its numbers and its times.

    Raises MapError if a recording has no images, or is named twice.
    """
    if len(recordings) == 1:
        only = recordings[0]
        return JoinedDrives([only.observation(frame) for frame in only.frames], (), ())
    _check(recordings)
    observations = list[Observation]()
    drives = list[JoinedDrive]()
    findings = list[Finding]()
    added_s = 0.0
    for before, recording in zip([None, *recordings], recordings, strict=False):
        joined = _following(recording, observations, drives)
        if before is not None and is_continued(before, recording):
            joined = replace(joined, continues=drives[-1].name)
        else:
            added_s = _added_seconds(recording, recordings[0], observations)
        added = joined.added_steps
        observations += [_moved(recording, frame, recordings[0], added, added_s) for frame in recording.frames]
        drives.append(replace(joined, world_offset_s=joined.world_offset_s - added_s))
        findings += _findings(recording, recordings[0])
    return JoinedDrives(observations, tuple(drives), tuple(findings))


def _check(recordings: Sequence[Recording]) -> None:
    paths = [recording.path.resolve() for recording in recordings]
    if twice := next((path for path in paths if paths.count(path) > 1), None):
        raise MapError(f"{twice.name} is named twice; name each drive once.")
    for recording in recordings:
        if not recording.frames:
            raise MapError(f"{recording.path} contains no images; leave it out, or record it again.")


def _following(recording: Recording, before: Sequence[Observation], drives: Sequence[JoinedDrive]) -> JoinedDrive:
    added = 0
    if before and recording.frames[0] <= before[-1].step:
        added = math.ceil((before[-1].step + 1 - recording.frames[0]) / _ROUND) * _ROUND
    names = {drive.name for drive in drives}
    name = recording.path.name
    return JoinedDrive(
        name=name if name not in names else str(Path(recording.path.parent.name) / name),
        first=recording.frames[0] + added,
        last=recording.frames[-1] + added,
        added_steps=added,
        world_offset_s=_world_offset_s(recording),
    )


def _moved(recording: Recording, frame: FrameId, first: Recording, added_steps: int, added_s: float) -> Observation:
    seen = recording.observation(frame)
    if not have_same_rays(recording.meta.camera, first.meta.camera):
        seen = recorded_observation(seen, recording.meta.camera, first.meta.camera)
    return replace(seen, step=seen.step + added_steps, stamp=seen.stamp + added_s)


def _added_seconds(recording: Recording, first: Recording, before: Sequence[Observation]) -> float:
    """Return the seconds to add to the clock of a drive so that it follows the drives before it.

    They are mostly 0 if the clocks show calendar time. If both clocks start at zero, the calendar gives the time
    between the drives.
    """
    begins_s = float(recording.poses.stamps[0])
    if not before or begins_s > before[-1].stamp:
        return 0.0
    later_s = _started_later(recording, first)
    return max(float(first.poses.stamps[0]) + later_s, before[-1].stamp + _PAUSE_S) - begins_s


def _started_later(recording: Recording, first: Recording) -> float:
    try:
        began = [datetime.fromisoformat(each.meta.started_at) for each in (first, recording)]
        return (began[1] - began[0]).total_seconds()
    except (ValueError, TypeError):  # Other software writes it in another form, or not at all.
        return 0.0


def _world_offset_s(recording: Recording) -> float:
    """Return the time of the world at stamp 0 of a recording, in seconds; 0 if the recording does not contain it."""
    told = (stamped for stamped in recording.events if isinstance(stamped.event, WorldChanged))
    for stamped in told:
        assert isinstance(stamped.event, WorldChanged)
        return stamped.event.at_s - stamped.stamp
    return 0.0


def _findings(recording: Recording, first: Recording) -> list[Finding]:
    """Return a finding if a recording seems to be of another place than the first."""
    here = recording.meta
    there = first.meta
    if may_be_one_place(here, there):
        return []
    named = f"{recording.path.name} was recorded in {here.scene!r}, {first.path.name} in {there.scene!r}"
    return [Finding(f"{named}; only drives through the same place make one map.", where=recording.path.name)]
