"""A recording in the page: the same moments as live, at any time one likes.

Owns the place in time and the image on show. Never writes, and keeps no image but the one on show.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import LtvnError
from ltvn_core.predictors.choice import IMPORTED
from ltvn_core.recording.garbage_collection import garbage_collection_paused
from ltvn_core.recording.metadata import RecordingMetadata
from ltvn_core.recording.reader import Recording
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import FrameId, NodeId, Observation
from ltvn_viz.session.live_run import TICK_S
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.replay_method import ReplayMethod
from ltvn_viz.session.snapshot import CameraImage, PlaybackStatus
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor
from ltvn_viz.timeline.run_moment import TRAJECTORY_POINTS, RunMoment, moment_of

MethodChoice: TypeAlias = Callable[[RecordingMetadata], ReplayMethod | None]
"""How a recording's images are to be compared; None as those of the robot."""


class ObservationSource(Protocol):
    """Where a replay finds the images of its frames."""

    def observation(self, frame: FrameId) -> Observation:
        """Read one image."""
        ...


class Playback:
    """An open recording."""

    mode = Mode.REPLAY

    def __init__(
        self,
        name: str,
        scene: str,
        timeline: Timeline,
        observations: ObservationSource,
        *,
        camera: CameraModel = LOCOBOT.camera,
        weights: str = "",
        system: str = "",
        maintenance: str = "",
        is_imported: bool = False,
        method: ReplayMethod | None = None,
    ) -> None:
        """Show the recording `name`, made in `scene`, from its beginning.

        `camera` took its images, `weights` is the fingerprint of the network that it was made with, `system` the name
        of what planned and `maintenance` of what driving taught the map, if known. `is_imported` says that another
        program took the images, with whatever carried the camera. `method` compares the images; None does it as the
        robot does.
        """
        self.name, self.scene, self.weights, self.system = name, scene, weights, system
        self.maintenance = maintenance
        self.camera_model, self.is_imported = camera, is_imported
        self.method = method
        self.timeline, self._observations = timeline, observations
        self._start_s = timeline.start_s
        self.length_s = max(0.0, timeline.end_s - self._start_s)
        self.time_s = 0.0
        self.playing = False
        self.speed = 1.0
        """Plays so many times as fast as it happened."""
        self.found: NodeId | None = None
        """Where an uploaded image was taken; shown with a pin."""
        self.breakpoint_monitor = BreakpointMonitor()
        """What it stops at while it plays."""
        self._shown: tuple[FrameId | None, CameraImage | None] = (None, None)

    @property
    def status(self) -> PlaybackStatus:
        """Where in the recording we are."""
        return PlaybackStatus(self.name, self.length_s, self.time_s, self.playing)

    @property
    def stamp(self) -> float:
        """The place in time on the robot's clock, seconds; the end is the end, however it is rounded."""
        return self.timeline.end_s if self.time_s >= self.length_s else self._start_s + self.time_s

    @cached_property
    def course(self) -> NDArray[np.float64]:
        """(T, 3) all poses of the run, thinned."""
        frames = self.timeline.frames
        return frames.trajectory(len(frames), TRAJECTORY_POINTS)

    def seek(self, time_s: float) -> None:
        """Go to so many seconds after the beginning; beyond either end means the end."""
        self.time_s = min(max(0.0, time_s), self.length_s)

    def play(self, *, playing: bool) -> None:
        """Run or hold; running from the end begins again."""
        if playing and self.time_s >= self.length_s:
            self.time_s = 0.0
        self.playing = playing

    def tick(self) -> None:
        """Let a tick of recorded time pass."""
        if not self.playing:
            return
        before, until = self.time_s, self.time_s + TICK_S * self.speed
        stop = self.breakpoint_monitor.first_between(self.timeline, before, until)
        self.seek(until if stop is None else stop.time_s)
        self.playing = stop is None and self.time_s < self.length_s
        if stop is not None:
            self.breakpoint_monitor.announce(stop)

    def moment(self) -> RunMoment:
        """Return the world at the present place in time."""
        return moment_of(self.timeline, self.stamp)

    def camera(self, frame: FrameId | None) -> CameraImage | None:
        """Return the image of a frame; None when it cannot be read."""
        if frame != self._shown[0]:
            self._shown = frame, self._read(frame)
        return self._shown[1]

    def observation(self, frame: FrameId) -> Observation | None:
        """Return an image of the recording, for a thumbnail; None when it has none."""
        try:
            return self._observations.observation(frame)
        except LtvnError:
            return None

    def _read(self, frame: FrameId | None) -> CameraImage | None:
        seen = None if frame is None else self.observation(frame)
        return None if seen is None else CameraImage(seen.rgb, seen.depth)


def open_replay(library: RecordingLibrary, name: str, choose_method: MethodChoice = lambda _: None) -> Playback:
    """Read a recording of the library for the page; raises RecordingError."""
    with garbage_collection_paused():
        recording = Recording.open(library.path(name))
        poses = recording.poses
        drawn = poses.odometry if poses.exact is None else poses.exact
        frames = list(zip(poses.steps.tolist(), poses.stamps.tolist(), drawn, strict=True))
        timeline = Timeline.of(recording.events, frames)
    meta = recording.meta
    return Playback(
        name,
        meta.scene,
        timeline,
        recording,
        camera=meta.camera,
        weights=meta.fingerprint,
        system=str(meta.config.get("system", "")),
        maintenance=str(meta.config.get("maintenance") or ""),
        is_imported=meta.config.get("verb") == IMPORTED,
        method=choose_method(meta),
    )
