"""One moment of a run for drawing: robot, trajectory, map, and recent additions and removals.

Owns the preparation for drawing: interpolation between images, thinning and fading. `ltvn_core.analysis.timeline` knows
the events. Two equal moments of a run share their arrays.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.map_history import EMPTY_GRAPH, NO_FADING_EDGES, FadingEdges, GraphArrays
from ltvn_core.analysis.recorded_frames import NO_TRAJECTORY, RecordedFrames
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.geometry import compose, wrap_angle
from ltvn_core.navigation.event_table import NO_PROGRESS, NavigationProgress
from ltvn_core.types import FrameId, Pose

FADE_S = 3.0
"""Time for which an added or removed edge stays highlighted, in seconds."""
TRAJECTORY_POINTS = 2000
"""Maximum number of points of the thinned trajectory."""
MAX_INTERPOLATION_GAP_S = 0.35
"""Greatest interval between two images in seconds for which the robot's pose is interpolated."""


@dataclass(frozen=True, slots=True, eq=False)
class RunMoment:
    """Everything that the page draws of a run at one moment."""

    stamp: float = 0.0
    """Time on the robot's clock, in seconds."""
    frame: FrameId | None = None
    """The newest image; None before the first."""
    robot: Pose | None = None
    """Pose (3,) at which the robot is drawn; None before the first image."""
    trajectory: NDArray[np.float64] = field(default_factory=lambda: NO_TRAJECTORY, repr=False)
    """Poses (T, 3) so far, thinned."""
    frames: int = 0
    """Number of images so far."""
    graph: GraphArrays = EMPTY_GRAPH
    added_edges: FadingEdges = NO_FADING_EDGES
    removed_edges: FadingEdges = NO_FADING_EDGES
    progress: NavigationProgress = NO_PROGRESS
    predicted_subgoal: Pose | None = None
    """Predicted pose (3,) of the current subgoal; None while no edge is driven."""


def moment_of(timeline: Timeline, stamp: float | None = None) -> RunMoment:
    """Return what the page draws of a run at `stamp` seconds, or at its end for None."""
    # All events of the newest step are included, as in every answer about this moment.
    known = len(timeline.events) if stamp is None else timeline.count_until(timeline.instant_at(stamp))
    stamp = timeline.end_s if stamp is None else stamp
    frames = timeline.frames.count_at(stamp)
    version = timeline.change_count_before(known)
    progress = timeline.progress_before(known)
    return RunMoment(
        stamp=stamp,
        frame=timeline.frames.step(frames - 1) if frames else None,
        robot=_robot_pose(timeline.frames, frames, stamp),
        trajectory=timeline.frames.trajectory(frames, TRAJECTORY_POINTS),
        frames=frames,
        graph=timeline.drawing.at(version),
        added_edges=timeline.drawing.added_edges(version, stamp, FADE_S),
        removed_edges=timeline.drawing.removed_edges(version, stamp, FADE_S),
        progress=progress,
        predicted_subgoal=_predicted_subgoal(timeline.frames, progress),
    )


def _predicted_subgoal(frames: RecordedFrames, progress: NavigationProgress) -> Pose | None:
    departure = None if progress.attempt is None else frames.pose(progress.attempt.frame)
    if progress.attempt is None or departure is None:
        return None
    return compose(departure, np.array(progress.attempt.waypoint))


def _robot_pose(frames: RecordedFrames, count: int, stamp: float) -> Pose | None:
    """Return the pose (3,) of the robot between image number `count` and the next one; None before the first image."""
    if not count:
        return None
    before = frames.driven_pose(count - 1)
    if count == len(frames):
        return before
    began = frames.stamp(count - 1)
    gap = frames.stamp(count) - frames.stamp(count - 1)
    if not 0 < gap <= MAX_INTERPOLATION_GAP_S:
        return before
    step = frames.driven_pose(count) - before
    step[2] = wrap_angle(step[2])
    return before + (stamp - began) / gap * step
