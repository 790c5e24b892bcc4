"""Teleoperation: a person drives, and the map grows from the camera's images.

Owns the choice of keyframes, and the limit of keyframes that wait for the mapper.
"""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from ltvn_core.data.recording.recorded_run import DepthWatch
from ltvn_core.geometry import relative
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.types import FrameId, Observation, Pose, Twist
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes.modes import Mode

KEYFRAME_M = 0.12
KEYFRAME_RAD = float(np.deg2rad(10))
LAG_LIMIT = 50
"""Largest number of keyframes that wait for the mapper; older ones are recorded, but not added to the map."""


class Teleop:
    """Drive by hand."""

    mode = Mode.TELEOP

    def __init__(self, live: LiveRun, worker: Worker, offer: Callable[[Observation], Sequence[GraphDelta]]) -> None:
        """Drive the live robot; `offer` gives an image to the map in the worker's thread and returns the changes.

        A missing robot, whose pose is not finite, takes no images.
        """
        self._live = live
        self._worker = worker
        self._offer = offer
        self._moving = False
        self._step: FrameId | None = None
        self._waiting: deque[Observation] = deque(maxlen=LAG_LIMIT)
        self._mapping = False
        self._depth_watch = DepthWatch()
        self._captured: Pose | None = None
        self._keyframe: Pose | None = None

    @property
    def is_driven(self) -> bool:
        """Whether a person drives now."""
        return self._moving

    @property
    def is_mapping(self) -> bool:
        """Whether images wait for the mapper."""
        return self._mapping or bool(self._waiting)

    def handle(self, twist: Twist | None) -> None:
        """Forward the driver's current input; releasing it stops the robot at once."""
        if twist is not None:
            self._live.robot.drive(twist)
        elif self._moving:
            self._live.robot.stop()
        self._moving = twist is not None

    def tick(self) -> None:
        """Advance time; at a new control step take an image, if anything moved."""
        self._live.let_pass(self._live.tick_s)
        step = self._live.robot.state().step
        if step != self._step:
            self._step = step
            self._look()
        self._map()

    def _look(self) -> None:
        pose = self._live.robot.state().odometry
        if not np.isfinite(pose).all():
            return
        if self._captured is not None and np.array_equal(pose, self._captured):
            # A standing robot sees nothing new for the map, but people may walk past, and doors may close.
            self._live.glance()
            return
        self._captured = pose
        observation = self._live.capture()
        if (note := self._depth_watch.note(observation)) is not None:
            self._live.emit(note)
        if self._keyframe is None or _moved(self._keyframe, pose):
            self._keyframe = pose
            self._waiting.append(observation)

    def _map(self) -> None:
        if self._waiting and not self._mapping:
            self._mapping = True
            observation = self._waiting.popleft()
            self._worker.submit(
                lambda: self._offer(observation),
                lambda deltas: self._mapped(observation, deltas),
                otherwise=self._mapping_ended,
            )

    def _mapping_ended(self) -> None:
        self._mapping = False

    def _mapped(self, observation: Observation, deltas: Sequence[GraphDelta]) -> None:
        self._mapping_ended()
        if deltas:
            # A recording that began while the image waited needs the image too, because its map will use it.
            self._live.recorder.write_frame(observation)
        self._live.emit_changes(deltas)


def _moved(before: Pose, after: Pose) -> bool:
    step = relative(before, after)
    return bool(np.hypot(step[0], step[1]) >= KEYFRAME_M or abs(step[2]) >= KEYFRAME_RAD)
