"""Everything that happened, in order, and what the world looked like at any moment of it.

The live session appends while it runs and looks at the end; the replay is filled from a file and looks anywhere. Both
get the same `RunMoment`. Images are not kept here.
"""

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose, wrap_angle
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId, Pose
from ltvn_viz.timeline.graph_history import EMPTY_GRAPH, NO_FADING_EDGES, FadingEdges, GraphArrays, GraphHistory
from ltvn_viz.timeline.growing_table import GrowingTable
from ltvn_viz.timeline.navigation_progress import NavigationProgress, apply_event

FADE_S = 3.0
"""How long an edge that came or went stays highlighted."""
TRAJECTORY_POINTS = 2000
"""The trajectory is thinned to at most this many points."""
NO_TRAJECTORY = np.empty((0, 3))
NO_PROGRESS = NavigationProgress()
MAX_INTERPOLATION_GAP_S = 0.35
"""Frames no further apart than this are joined by interpolation when a replay runs."""


@dataclass(frozen=True, slots=True, eq=False)
class RunMoment:
    """The world as the fold of everything up to one instant."""

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


class RunTimeline:
    """The frames and events of one run."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.history = GraphHistory()
        self._frames = GrowingTable({"step": int, "stamp": float, "x": float, "y": float, "yaw": float})
        self._poses: dict[FrameId, Pose] = {}
        self._stamps: list[float] = []
        self._versions: list[int] = []
        self._progress: list[NavigationProgress] = []
        self.events: list[StampedEvent] = []
        self._line: tuple[int, NDArray[np.float64]] = (0, NO_TRAJECTORY)

    @property
    def start_s(self) -> float:
        """When driving began, seconds on the robot's clock; without any image, when the first thing happened."""
        return next(iter([*self._frames["stamp"][:1].tolist(), *self._stamps[:1]]), 0.0)

    @property
    def end_s(self) -> float:
        """The last moment, seconds on the robot's clock."""
        return max([*self._frames["stamp"][-1:].tolist(), *self._stamps[-1:]], default=0.0)

    def step_at(self, stamp: float) -> FrameId:
        """Return the newest step at `stamp` seconds: of an image or of an event, -1 before the first."""
        frames = int(np.searchsorted(self._frames["stamp"], stamp, "right"))
        known = bisect_right(self._stamps, stamp)
        last_frame = int(self._frames["step"][frames - 1]) if frames else -1
        return max(last_frame, self.events[known - 1].step if known else -1)

    def pose(self, frame: FrameId) -> Pose | None:
        """Return where an image was taken, (3,); None if nobody said."""
        return self._poses.get(frame)

    def place(self, frame: FrameId, pose: Pose) -> None:
        """Say where an image was taken (3,), for an image that is not part of this run's trajectory."""
        self._poses[frame] = pose

    def frame(self, step: FrameId, stamp: float, pose: Pose) -> None:
        """Append an image taken at `pose` (3,)."""
        stamp = max(stamp, float(self._frames["stamp"][-1])) if len(self._frames) else stamp
        self._frames.append(step=step, stamp=stamp, x=pose[0], y=pose[1], yaw=pose[2])
        self.place(step, pose)

    def event(self, stamped: StampedEvent) -> None:
        """Append an event. One that comes late is filed under the latest moment, so that time never runs back."""
        stamp = max(stamped.stamp, self._stamps[-1]) if self._stamps else stamped.stamp
        if isinstance(stamped.event, GraphChanged):
            delta = stamped.event.delta
            seen_from = self._poses.get(delta.node.id) if isinstance(delta, NodeAdded) else None
            self.history.apply(delta, stamp, seen_from)
        self._progress.append(apply_event(self._progress[-1] if self._progress else NO_PROGRESS, stamped.event))
        self._stamps.append(stamp)
        self._versions.append(self.history.version)
        self.events.append(stamped)

    def at(self, stamp: float | None = None) -> RunMoment:
        """Return the world at `stamp` seconds, or now."""
        if stamp is None:
            stamp, known = self.end_s, len(self._stamps)
        else:
            known = bisect_right(self._stamps, stamp)
        frames = int(np.searchsorted(self._frames["stamp"], stamp, "right"))
        version = self._versions[known - 1] if known else 0
        progress = self._progress[known - 1] if known else NO_PROGRESS
        return RunMoment(
            stamp=stamp,
            frame=int(self._frames["step"][frames - 1]) if frames else None,
            robot=self._robot(frames, stamp),
            trajectory=self._trajectory(frames),
            frames=frames,
            graph=self.history.at(version),
            added_edges=self.history.added_edges(version, stamp, FADE_S),
            removed_edges=self.history.removed_edges(version, stamp, FADE_S),
            progress=progress,
            predicted_subgoal=self._predicted_subgoal(progress),
        )

    def _predicted_subgoal(self, progress: NavigationProgress) -> Pose | None:
        if progress.attempt is None or progress.attempt.frame not in self._poses:
            return None
        return compose(self._poses[progress.attempt.frame], np.array(progress.attempt.waypoint))

    def _robot(self, frames: int, stamp: float) -> Pose | None:
        if not frames:
            return None
        before = self._row(frames - 1)
        if frames == len(self._frames):
            return before[1:]
        following = self._row(frames)
        gap = following[0] - before[0]
        if not 0 < gap <= MAX_INTERPOLATION_GAP_S:
            return before[1:]
        share = (stamp - before[0]) / gap
        step = following[1:] - before[1:]
        step[2] = wrap_angle(step[2])
        return before[1:] + share * step

    def _row(self, row: int) -> NDArray[np.float64]:
        return np.array([self._frames[name][row] for name in ("stamp", "x", "y", "yaw")])

    def _trajectory(self, frames: int) -> NDArray[np.float64]:
        # While nothing was driven the same array is returned, so that layers see at a glance that nothing changed.
        if self._line[0] != frames:
            stride = -(-frames // TRAJECTORY_POINTS)
            rows = np.unique(np.r_[np.arange(0, frames, stride), frames - 1]) if frames else np.empty(0, int)
            self._line = frames, np.stack([self._frames[name][rows] for name in ("x", "y", "yaw")], axis=1)
        return self._line[1]
