"""Playback of a recording in the page: the same moments as live, in any order.

Owns the current time and image. Never writes, and keeps no other image in memory.

The images are compared by the predictor that the recording or its map names; `ltvn_core.predictors.choice` makes that
choice.
"""

import logging
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import have_same_rays
from ltvn_core.config import Method
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError
from ltvn_core.garbage_collection import garbage_collection_paused
from ltvn_core.graph.corrections import UnsurePlaces
from ltvn_core.predictors.choice import IMPORTED, ImageSource, PredictorChoice
from ltvn_core.predictors.opening import NETWORK, open_method, open_predictor
from ltvn_core.readable_text import readable
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.systems.registry import open_system
from ltvn_core.types import FrameId, NodeId, Observation, Predictor
from ltvn_viz.session.camera_feed import image_of
from ltvn_viz.session.live_run import TICK_S
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.snapshot import CameraImage
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor, time_of
from ltvn_viz.timeline.run_moment import TRAJECTORY_POINTS, RunMoment, moment_of
from ltvn_viz.wishes.modes import Mode

logger = logging.getLogger(__name__)


class ReplayMethod(NamedTuple):
    """How the images of a recording are compared."""

    predictor: Predictor
    method: Method
    """The thresholds, with the constants measured for the predictor."""


class ReplayMethods:
    """Opens predictors for recordings, each once. Use it only in the worker's thread."""

    def __init__(self, options: AppOptions, robots: Predictor) -> None:
        """Take the options, which name the predictor, and the open predictor for the robot's camera."""
        self._options = options
        self._robots = robots
        self._opened: dict[str, ReplayMethod] = {}

    def of(self, meta: RecordingMetadata) -> ReplayMethod | None:
        """Return the method that compares a recording's images.

        None means the robot's method, which is also used if the recording's own cannot be opened here.
        """
        try:
            choice = ImageSource.of(meta).choose()
            return None if self._is_the_robots(choice, meta.camera) else self._open(choice, meta)
        except LtvnError as error:
            logger.info("The recording's images are compared with the same predictor as the robot's: %s", error)
            return None

    def _is_the_robots(self, choice: PredictorChoice, camera: CameraModel) -> bool:
        if choice.name != self._options.predictor:
            return False
        # The network takes images of one camera only, so all others are rectified to it.
        return choice.name == NETWORK or have_same_rays(camera, self._robots.camera)

    def _open(self, choice: PredictorChoice, meta: RecordingMetadata) -> ReplayMethod:
        key = repr((choice.name, meta.scene, meta.camera))
        if key not in self._opened:
            options = self._options
            predictor = open_predictor(
                choice.name, meta.scene, options.start_weights, camera=meta.camera, device=options.device
            )
            system = open_system(options.system, open_method(options.preset, predictor))
            self._opened[key] = ReplayMethod(predictor, system.method)
        return self._opened[key]


MethodChoice: TypeAlias = Callable[[RecordingMetadata], ReplayMethod | None]
"""Returns the method that compares a recording's images; None for the method of the robot."""


class Playback:
    """An open recording."""

    mode = Mode.REPLAY

    def __init__(
        self,
        name: str,
        scene: str,
        timeline: Timeline,
        observation: Callable[[FrameId], Observation],
        *,
        camera: CameraModel = LOCOBOT.camera,
        config: Mapping[str, Any],
        weights: str = "",
        method: ReplayMethod | None = None,
    ) -> None:
        """Show the recording `name`, made in `scene`, from its beginning.

        `camera` took the images, `weights` is the fingerprint of the network in the recording, and `config` says how it
        was made. `method` compares the images; None compares them as the robot does.
        """
        self.name = name
        self.scene = scene
        self.weights = weights
        self.system = str(config.get("system", ""))
        self.maintenance = str(config.get("maintenance") or "")
        self.unsure = UnsurePlaces.recorded(config)
        self.camera_model = camera
        self.is_imported = config.get("verb") == IMPORTED  # By another program, so the robot is unknown.
        self.method = method
        self.timeline = timeline
        self._observation = observation
        self._start_s = timeline.start_s
        self.length_s = max(0.0, timeline.end_s - self._start_s)
        self.time_s = 0.0
        self.playing = False
        self.speed = 1.0
        """Playback speed as a factor of real time."""
        self.found: NodeId | None = None
        """Node where an uploaded image was taken; shown with a pin."""
        self.breakpoint_monitor = BreakpointMonitor()
        """Breakpoints at which playback stops."""
        self._shown: tuple[FrameId | None, CameraImage | None] = (None, None)

    @property
    def stamp(self) -> float:
        """Current time on the robot's clock, in seconds; exact at the end of the recording, despite rounding."""
        return self.timeline.end_s if self.time_s >= self.length_s else self._start_s + self.time_s

    @cached_property
    def course(self) -> NDArray[np.float64]:
        """(T, 3) all poses of the run, thinned."""
        frames = self.timeline.frames
        return frames.trajectory(len(frames), TRAJECTORY_POINTS)

    def seek(self, time_s: float) -> None:
        """Seek to a time in seconds after the beginning; a time outside the recording seeks to the nearer end."""
        self.time_s = min(max(0.0, time_s), self.length_s)

    def play(self, *, playing: bool) -> None:
        """Play or pause; playing from the end starts at the beginning."""
        if playing and self.time_s >= self.length_s:
            self.time_s = 0.0
        self.playing = playing

    def tick(self) -> None:
        """Advance the recorded time by a tick."""
        if not self.playing:
            return
        before = self.time_s
        until = self.time_s + TICK_S * self.speed
        stop = self.breakpoint_monitor.first_between(self.timeline, before, until)
        self.seek(until if stop is None else time_of(self.timeline, stop))
        self.playing = stop is None and self.time_s < self.length_s
        if stop is not None:
            self.breakpoint_monitor.announce(self.timeline, stop)

    def moment(self) -> RunMoment:
        """Return the state of the run at the current time."""
        return moment_of(self.timeline, self.stamp)

    def camera(self, frame: FrameId | None) -> CameraImage | None:
        """Return the image of a frame; None when it cannot be read."""
        if frame != self._shown[0]:
            self._shown = frame, self._read(frame)
        return self._shown[1]

    def observation(self, frame: FrameId) -> Observation | None:
        """Return an image of the recording, for a thumbnail; None when it has none."""
        try:
            return self._observation(frame)
        except LtvnError:
            return None

    def _read(self, frame: FrameId | None) -> CameraImage | None:
        seen = None if frame is None else self.observation(frame)
        return None if seen is None else image_of(seen)


def open_replay(library: RecordingLibrary, name: str, choose_method: MethodChoice = lambda _: None) -> Playback:
    """Read a recording of the library for the page; raises RecordingError."""
    return read_replay(library.path(name), choose_method)


def read_replay(path: Path, choose_method: MethodChoice = lambda _: None) -> Playback:
    """Read a recording or a map as a replay; raises RecordingError."""
    with garbage_collection_paused():
        recording = Recording.open(path)
        poses = recording.poses
        drawn = poses.odometry if poses.exact is None else poses.exact
        frames = list(zip(poses.steps.tolist(), poses.stamps.tolist(), drawn, strict=True))
        timeline = Timeline.of(recording.events, frames)
    meta = recording.meta
    return Playback(
        readable(path.name),
        meta.scene,
        timeline,
        recording.observation,
        camera=meta.camera,
        config=meta.config,
        weights=meta.fingerprint,
        method=choose_method(meta),
    )
