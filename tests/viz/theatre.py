"""A whole session for tests: a flat world, a robot and predictor that know it, and a driver that does what it is told.

Everything runs in one thread, in simulated time; nothing sleeps. Owns no assertion.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.model.predictor import load_predictor
from ltvn_core.nav.events import GraphChanged, Stamped
from ltvn_core.types import CONTROL_STEP_S, FrameId, Observation, Pose, Twist
from ltvn_viz import commands as c
from ltvn_viz.absent import AbsentFeed
from ltvn_viz.goals import Goals
from ltvn_viz.learning import Learning
from ltvn_viz.library import Library
from ltvn_viz.live import Live
from ltvn_viz.mapping import Mapping
from ltvn_viz.recorder import Recorder
from ltvn_viz.replay import Replay, timeline_of
from ltvn_viz.session import Session
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.stage import Stage
from ltvn_viz.teleop import Teleop
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.timeline import Timeline
from ltvn_viz.worker import Worker
from tests.core.world import FlatPredictor, FlatRobot, FlatWorld, one_room, tour

PATIENCE_S = 30.0
"""So long may other threads need, on a busy machine."""

_A_FEW_MORE, _AT_WORK = 20, " …</div>"

WAY = ((1.0, 1.0), (4.0, 1.0), (4.0, 3.0))
"""A tour through the single room."""


ONE_ROOM = one_room()


class Inline(Executor):
    """Does each job at once, in the caller's thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except BaseException as error:
            done.set_exception(error)
        return done


class LiveFlatRobot(FlatRobot):
    """A flat robot whose time passes in any portions."""

    def __init__(self, world: FlatWorld, pose: tuple[float, float, float], *, first_step: int = 0) -> None:
        super().__init__(world, pose, first_step=first_step)
        self.broken: Exception | None = None
        self._owed_s = 0.0

    @property
    def exact_pose(self) -> Pose:
        return self.pose

    @property
    def stamp(self) -> float:
        return self.step * CONTROL_STEP_S + self._owed_s

    def advance(self, duration_s: float = CONTROL_STEP_S) -> None:
        if self.broken is not None:
            raise self.broken
        self._owed_s += duration_s
        while self._owed_s >= CONTROL_STEP_S - 1e-9:
            self._owed_s = max(0.0, self._owed_s - CONTROL_STEP_S)
            super().advance()


@dataclass
class Tape:
    """A writer that keeps everything in memory, and fails when it is told to."""

    path: Path
    frames: list[Observation] = field(default_factory=list)
    events: list[Stamped] = field(default_factory=list)
    closed: bool = False
    full: bool = False

    def frame(self, observation: Observation) -> None:
        if self.full:
            raise OSError(28, "No space left on device")
        if observation.step not in {seen.step for seen in self.frames}:
            self.frames.append(observation)

    def event(self, stamped: Stamped) -> None:
        self.events.append(stamped)

    def graph(self, graph: object, step: FrameId, stamp: float) -> None:
        """Draw nothing."""

    def close(self) -> None:
        self.closed = True


@dataclass
class PuppetDriver:
    """Holds what the test says."""

    twist: Twist | None = None

    def current_twist(self) -> Twist | None:
        return self.twist


class Theatre:
    """A session with handles on all its parts."""

    def __init__(
        self,
        folder: Path,
        *,
        world: FlatWorld | None = None,
        way: Sequence[Sequence[float]] = WAY,
        mapped: bool = True,
        executor: Executor | None = None,
        learning: Learning | None = None,
    ) -> None:
        """Set the stage, with a map of a tour along `way` unless told otherwise; jobs are done at once by default."""
        self.world = world or ONE_ROOM
        self.driver = PuppetDriver()
        self.shown: list[Snapshot] = []
        self.tapes: list[Tape] = []
        self.library = Library(folder)
        self.thumbnails = Thumbnails()
        seen, deltas = mapped_tour(self.world.walls.tobytes(), tuple(map(tuple, way))) if mapped else ((), ())
        first_step = max((picture.step for picture in seen), default=-1) + 1
        self.robot = LiveFlatRobot(self.world, (1.0, 1.0, 0.0), first_step=first_step)
        worker = Worker(executor or Inline())
        mapping = Mapping(FlatPredictor(self.world), ROBUST, np.random.default_rng(0))
        live = Live(self.robot, Recorder(self.library, self._open_writer, lambda: datetime(2030, 1, 2)), Timeline())
        goals = Goals(mapping, worker, self.thumbnails)
        teleop = Teleop(live, worker, mapping.offer)
        self.stage = Stage(
            "flat",
            live,
            mapping,
            worker,
            self.library,
            self.open_replay,
            AbsentFeed(),
            goals,
            teleop,
            learning or Learning(None, None, Inline()),
            lambda weights: (load_predictor(weights), ROBUST),
        )
        self.session = Session(self.stage, self.driver, self.shown.append)
        for picture in seen:
            live.timeline.place(picture.step, np.asarray(picture.exact_pose))
        for delta in mapping.load(TopologicalGraph(deltas), seen):
            live.emit(GraphChanged(delta))

    @property
    def now(self) -> Snapshot:
        """What the page shows."""
        return self.shown[-1]

    def do(self, *commands: c.Command, ticks: int = 1) -> Snapshot:
        """Send commands, let ticks pass, and return what the page shows then."""
        for command in commands:
            self.session.send(command)
        return self.wait(ticks)

    def wait(self, ticks: int = 1) -> Snapshot:
        """Let ticks pass and return what the page shows then.

        Whoever lets several pass waits for an answer; on a slow machine that takes a few more.
        """
        for _ in range(ticks):
            self.session.tick()
        for _ in range(_A_FEW_MORE):
            if ticks == 1 or _AT_WORK not in self.now.inspection.html:
                break
            self.session.tick()
        return self.now

    def until(self, holds: Callable[[Snapshot], bool], ticks: int = 9000) -> Snapshot:
        """Let ticks pass until something holds, as many as asked for and longer where other threads are still busy."""
        patience = time.monotonic() + PATIENCE_S
        while ticks > 0 or time.monotonic() < patience:
            if holds(self.wait()):
                return self.now
            ticks -= 1
        raise AssertionError(f"never happened; at last: {self.now}")

    def open_replay(self, name: str) -> Replay:
        """Play a tape back."""
        self.library.path(name)
        tape = next(tape for tape in self.tapes if tape.path.name == name)
        frames = [(seen.step, seen.stamp, np.asarray(seen.exact_pose)) for seen in tape.frames]
        pictures = {seen.step: seen for seen in tape.frames}
        return Replay(name, "flat", timeline_of(frames, tape.events), _Pictures(pictures))

    def _open_writer(self, path: Path) -> Tape:
        path.touch(exist_ok=False)
        tape = Tape(path)
        self.tapes.append(tape)
        mapping = self.stage.mapping
        for seen in mapping.kept():
            tape.frame(seen)
        last = max((seen.step for seen in mapping.kept()), default=0)
        for delta in mapping.graph.deltas():
            tape.event(Stamped(last, last * CONTROL_STEP_S, GraphChanged(delta)))
        return tape


@lru_cache(maxsize=4)
def mapped_tour(
    walls: bytes, way: tuple[tuple[float, ...], ...]
) -> tuple[tuple[Observation, ...], tuple[GraphDelta, ...]]:
    """Return the pictures of a tour and the map that grows from them."""
    world = FlatWorld(np.frombuffer(walls).reshape(-1, 2, 2))
    seen, mapping = tuple(tour(way)), Mapping(FlatPredictor(world), ROBUST, np.random.default_rng(0))
    return seen, tuple(delta for picture in seen for delta in mapping.offer(picture))


@dataclass
class _Pictures:
    by_frame: dict[FrameId, Observation]

    def observation(self, frame: FrameId) -> Observation:
        return self.by_frame[frame]


def ahead(pose: Pose, metres: float) -> Pose:
    """Return the pose so far straight ahead."""
    return compose(pose, np.array([metres, 0.0, 0.0]))
