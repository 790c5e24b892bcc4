"""One moment of a run as the page draws it: robot, trajectory, map, and recent additions and removals.

Owns only matters of drawing: interpolation between images, thinning and fading. What happened, and when, is
`ltvn_core.analysis.timeline`. The same moment of the same run shares its arrays with the one drawn before.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.map_history import EMPTY_GRAPH, NO_FADING_EDGES, FadingEdges, GraphArrays
from ltvn_core.analysis.navigation_progress import NO_PROGRESS, NavigationProgress
from ltvn_core.analysis.recorded_frames import NO_TRAJECTORY, RecordedFrames
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.geometry import compose, wrap_angle
from ltvn_core.types import FrameId, Pose

FADE_S = 3.0
"""Time for which an added or removed edge stays highlighted, in seconds."""
TRAJECTORY_POINTS = 2000
"""The trajectory is thinned to at most this many points."""
MAX_INTERPOLATION_GAP_S = 0.35
"""Greatest time between frames that a replay interpolates."""


@dataclass(frozen=True, slots=True, eq=False)
class RunMoment:
    """Everything that is drawn of a run at one moment."""

    stamp: float = 0.0
    """Seconds on the robot's clock."""
    frame: FrameId | None = None
    """The newest image; None before the first."""
    robot: Pose | None = None
    """(3,) for drawing."""
    trajectory: NDArray[np.float64] = field(default_factory=lambda: NO_TRAJECTORY, repr=False)
    """(T, 3) poses driven so far, thinned."""
    frames: int = 0
    """Images taken so far."""
    graph: GraphArrays = EMPTY_GRAPH
    added_edges: FadingEdges = NO_FADING_EDGES
    removed_edges: FadingEdges = NO_FADING_EDGES
    progress: NavigationProgress = NO_PROGRESS
    predicted_subgoal: Pose | None = None
    """(3,) where the network thinks the present subgoal is."""


def moment_of(timeline: Timeline, stamp: float | None = None) -> RunMoment:
    """Return what is drawn of a run at `stamp` seconds, or at its end."""
    # All events of the newest step count, as in every answer about this moment.
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
    """Return (3,) where the robot is between image number `count` and the next, None before the first."""
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
