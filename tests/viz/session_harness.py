"""A whole session for tests: a flat world, a robot and predictor that know it, and a driver that does what it is told.

Everything runs in one thread, in simulated time; nothing sleeps. Owns no assertion.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.config import ROBUST
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.network.predictor import load_predictor
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, FrameId, NodeId, Observation, Predictor, RobotState, Twist
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.question_registry import all_questions
from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.fine_tuning import FineTuning
from ltvn_viz.session.live_map import LiveMap
from ltvn_viz.session.live_run import LiveRobot, LiveRun
from ltvn_viz.session.recorder import Recorder
from ltvn_viz.session.recording_library import RecordingLibrary
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes import commands as c
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, one_room, tour
from tests.waiting import until

WAY = ((1.0, 1.0), (4.0, 1.0), (4.0, 3.0))
"""A tour through the single room."""


ONE_ROOM = one_room()


class InlineExecutor(Executor):
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
        self.clock = _PortionClock(self)

    @property
    def stamp(self) -> float:
        return self.step * CONTROL_STEP_S + self._owed_s

    def state(self) -> RobotState:
        return super().state()._replace(stamp=self.stamp)

    def advance(self, duration_s: float = CONTROL_STEP_S) -> None:
        if self.broken is not None:
            raise self.broken
        self._owed_s += duration_s
        while self._owed_s >= CONTROL_STEP_S - 1e-9:
            self._owed_s = max(0.0, self._owed_s - CONTROL_STEP_S)
            super().advance()


class _PortionClock:
    """The clock of a `LiveFlatRobot`."""

    is_simulated = True

    def __init__(self, robot: LiveFlatRobot) -> None:
        self._robot = robot

    def now(self) -> float:
        return self._robot.stamp

    def advance(self, duration_s: float) -> None:
        self._robot.advance(duration_s)


@dataclass
class FakeWriter:
    """A writer that keeps everything in memory, and fails when it is told to."""

    path: Path
    frames: list[Observation] = field(default_factory=list)
    events: list[StampedEvent] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    closed: bool = False
    failure: str | None = None

    def write_map(self, graph: TopologicalGraph, observations: Sequence[Observation]) -> None:
        for seen in observations:
            self.write_frame(seen)
        last = max((seen.step for seen in observations), default=0)
        for delta in graph.deltas():
            self.write_event(StampedEvent(last, last * CONTROL_STEP_S, GraphChanged(delta)))

    def write_frame(self, observation: Observation) -> None:
        if observation.step not in {seen.step for seen in self.frames}:
            self.frames.append(observation)

    def write_event(self, stamped: StampedEvent) -> None:
        self.events.append(stamped)

    def write_question(self, word: str) -> None:
        self.asked.append(word)

    def draw_scene(self, glb: bytes) -> None:
        """Draw nothing."""

    def draw_graph(self, graph: object, step: FrameId, stamp: float) -> None:
        """Draw nothing."""

    def close(self) -> None:
        self.closed = True


class FakeDriver(DriverSeat):
    """Holds what the test says."""

    twist: Twist | None = None

    def current_twist(self, now: float | None = None) -> Twist | None:
        return self.twist


class SessionHarness:
    """A session with handles on all its parts."""

    def __init__(
        self,
        folder: Path,
        *,
        world: FlatWorld | None = None,
        way: Sequence[Sequence[float]] = WAY,
        mapped: bool = True,
        executor: Executor | None = None,
        recording_executor: Executor | None = None,
        open_writer: Callable[[Path], Any] | None = None,
        fine_tuning: FineTuning | None = None,
        own_robot: Robot | None = None,
        predictor: Predictor | None = None,
    ) -> None:
        """Open a session with a map of a tour along `way` unless told otherwise; jobs are done at once by default.

        It drives a flat robot, or `own_robot`, of which nobody knows where it really is.
        """
        self.world = world or ONE_ROOM
        self.driver = FakeDriver()
        self.shown: list[Snapshot] = []
        self.writers: list[FakeWriter] = []
        self.library = RecordingLibrary(folder)
        seen, deltas = mapped_tour(self.world.walls.tobytes(), tuple(map(tuple, way))) if mapped else ((), ())
        first_step = max((picture.step for picture in seen), default=-1) + 1
        self.robot = LiveFlatRobot(self.world, (1.0, 1.0, 0.0), first_step=first_step)
        worker = Worker(executor or InlineExecutor())
        live_map = LiveMap(
            TopologicalMap.of(predictor or FlatPredictor(self.world), ltvn_system(ROBUST)), np.random.default_rng(0)
        )
        robot = LiveRobot(own_robot or self.robot, ground_truth=None if own_robot else lambda: self.robot.pose)
        recorder = Recorder(
            self.library,
            open_writer or self._open_writer,
            lambda: datetime(2030, 1, 2),
            take_map=live_map.copied,
            executor=recording_executor or InlineExecutor(),
        )
        live = LiveRun(robot, recorder, Timeline())
        self.inspector = Inspector(all_questions(live.breakpoint_monitor), worker)
        self.state = AppState(
            scene="flat",
            live=live,
            live_map=live_map,
            worker=worker,
            library=self.library,
            open_replay=self.open_replay,
            fine_tuning=fine_tuning or FineTuning(None, None, InlineExecutor()),
            predictor_for=lambda weights: (load_predictor(weights), ltvn_system(ROBUST)),
            debugger=self.inspector,
        )
        self.session = Session(self.state, self.driver, self.shown.append)
        known = TopologicalMap.of(live_map.predictor, live_map.system, TopologicalGraph(deltas), seen)
        self.state.start_with(known, seen)

    @property
    def now(self) -> Snapshot:
        """What the page shows."""
        return self.shown[-1]

    @property
    def far_node(self) -> NodeId:
        """The node on show that is farthest from the robot."""
        graph = self.now.moment.graph
        return int(graph.ids[np.hypot(*(graph.poses[:, :2] - self.robot.pose[:2]).T).argmax()])

    @property
    def an_edge(self) -> EdgeKey:
        """Some edge of the live map."""
        return next(iter(self.state.live_map.graph.edges))

    def do(self, *commands: c.Command, ticks: int = 1) -> Snapshot:
        """Send commands, let ticks pass, and return what the page shows then."""
        for command in commands:
            self.session.send(command)
        return self.wait(ticks)

    def wait(self, ticks: int = 1) -> Snapshot:
        """Let ticks pass and return what the page shows then.

        Whoever lets several pass waits for an answer of the debugger too, which on a slow machine takes a few more.
        """
        for _ in range(ticks):
            self.session.tick()
        if ticks > 1:
            until(lambda: not self.now.inspection.answer.is_pending, meanwhile=self.session.tick)
        return self.now

    def until(self, holds: Callable[[Snapshot], bool]) -> Snapshot:
        """Let ticks pass until something holds, and return what the page shows then."""
        until(lambda: holds(self.wait()), meanwhile=lambda: None, explain=lambda: self.now)
        return self.now

    def open_replay(self, name: str) -> Playback:
        """Play back what a writer kept."""
        self.library.path(name)
        writer = next(writer for writer in self.writers if writer.path.name == name)
        frames = [(seen.step, seen.stamp, np.asarray(seen.exact_pose)) for seen in writer.frames]
        pictures = {seen.step: seen for seen in writer.frames}
        return Playback(name, "flat", Timeline.of(writer.events, frames), pictures.__getitem__, config={})

    def _open_writer(self, path: Path) -> FakeWriter:
        path.touch(exist_ok=False)
        writer = FakeWriter(path)
        self.writers.append(writer)
        return writer


@lru_cache(maxsize=4)
def mapped_tour(
    walls: bytes, way: tuple[tuple[float, ...], ...]
) -> tuple[tuple[Observation, ...], tuple[GraphDelta, ...]]:
    """Return the pictures of a tour and the map that grows from them."""
    world = FlatWorld(np.frombuffer(walls).reshape(-1, 2, 2))
    seen = tuple(tour(way))
    empty = TopologicalMap.of(FlatPredictor(world), ltvn_system(ROBUST))
    live_map = LiveMap(empty, np.random.default_rng(0))
    return seen, tuple(delta for picture in seen for delta in live_map.offer(picture))


def said(shown: Snapshot | AppState) -> str:
    """Return the message on show, or nothing."""
    return shown.message.text if shown.message is not None else ""
