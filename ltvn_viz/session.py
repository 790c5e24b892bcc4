"""The one loop: takes commands, moves the robot's time, and shows what comes of it.

Owns the pace, and what happens when something goes wrong. A single thread runs `run`; every other thread may only
`send`, `wake` and `stop`. What a mode does is in `teleop`, `navigation`, `building` and `replay`; what a command means
is in `orders`.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from ltvn_core.errors import LtvnError
from ltvn_core.types import Twist
from ltvn_viz import commands as c
from ltvn_viz.building import Building
from ltvn_viz.live import TICK_S
from ltvn_viz.modes import Mode
from ltvn_viz.navigation import Navigation
from ltvn_viz.orders import obey
from ltvn_viz.portrait import Portrait
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.stage import Stage
from ltvn_viz.stopping import heed

logger = logging.getLogger(__name__)

QUEUE_LIMIT = 256
"""More commands than this wait only if somebody floods the app; the rest is refused."""
STALL_S = 0.5
"""After a stall longer than this, the robot's time goes on from where it stood instead of catching up."""


class Driver(Protocol):
    """The seat of whoever drives by hand."""

    def current_twist(self) -> Twist | None:
        """Return the velocity asked for now, None when nobody drives."""
        ...


class Session:
    """The running app without its page."""

    def __init__(
        self,
        stage: Stage,
        driver: Driver,
        publish: Callable[[Snapshot], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Put the parts together; nothing runs before `run` or `tick`. `publish` must not block."""
        self._stage, self._driver, self._publish, self._clock = stage, driver, publish, clock
        self._portrait = Portrait(clock)
        self._commands: deque[c.Command] = deque()
        self._awake = threading.Event()
        self._stopping = threading.Event()

    @property
    def mode(self) -> Mode:
        """What the app is doing."""
        return self._stage.activity.mode

    @property
    def stage(self) -> Stage:
        """What the session runs; its own thread alone may change it."""
        return self._stage

    def send(self, command: c.Command) -> None:
        """Ask for something, from any thread; never blocks."""
        if len(self._commands) < QUEUE_LIMIT:
            self._commands.append(command)
        else:
            logger.warning("too many commands at once; left out %s", command)
        self.wake()

    def wake(self) -> None:
        """Let the session look at commands and driver now rather than at its next tick. Safe from any thread."""
        self._awake.set()

    def stop(self) -> None:
        """Let `run` return soon. Safe from any thread."""
        self._stopping.set()
        self.wake()

    def run(self, max_ticks: int | None = None) -> None:
        """Run in real time until `stop`, or for so many ticks; then the robot stands and the recording is kept."""
        ticks, due = 0, self._clock()
        try:
            while not self._stopping.is_set() and (max_ticks is None or ticks < max_ticks):
                self._awake.wait(max(0.0, due - self._clock()))
                self._awake.clear()
                self._guarded(self._react)
                if self._clock() < due:
                    continue  # Woken early: the command is carried out already, time is not due yet.
                self._guarded(self._advance)
                self._guarded(self._show)
                ticks += 1
                due = due + TICK_S if self._clock() - due < STALL_S else self._clock()
        finally:
            self.close()

    def tick(self) -> None:
        """React, let one tick of robot time pass, and publish; what `run` does, without waiting."""
        self._guarded(self._react)
        self._guarded(self._advance)
        self._guarded(self._show)

    def close(self) -> None:
        """Stop the robot and keep the recording under way."""
        self._stage.live.robot.stop()
        self._stage.give_up("The app is closing.")
        self._stage.learning.give_up()
        self._stage.worker.close()
        self._guarded(self._stage.worker.collect)
        self._stage.learning.close()
        if self._stage.live.recorder.is_on:
            logger.info("kept the recording %s", self._stage.live.recorder.keep())

    def _react(self) -> None:
        """Let commands and held keys reach the robot."""
        stage = self._stage
        while self._commands:
            obey(stage, self._commands.popleft())
        twist = self._driver.current_twist()
        if twist is not None and isinstance(stage.activity, Navigation) and not stage.activity.is_stopping:
            obey(stage, c.TakeOver())
        stage.teleop.obey(twist if stage.activity is stage.teleop else None)

    def _advance(self) -> None:
        """Let a tick of robot time pass."""
        stage = self._stage
        stage.worker.collect()
        stage.learning.collect()
        stage.activity.tick()
        heed(stage)
        if isinstance(stage.activity, Navigation | Building) and stage.activity.over:
            stage.activity = stage.teleop
        if stage.worker.pending == 0:
            # Nobody changes the map now, so the recording may draw it.
            stage.live.recorder.graph(stage.mapping.graph, stage.live.robot.step, stage.live.robot.stamp)

    def _show(self) -> None:
        self._publish(self._portrait.take(self._stage))

    def _guarded(self, part: Callable[[], None]) -> None:
        """Run a part of the loop; whatever goes wrong there, the robot stands, the page says so, the loop goes on."""
        try:
            part()
        except LtvnError as error:
            self._stage.fail(str(error))
        except Exception as error:
            logger.exception("the session failed")
            self._stage.fail(
                f"Something in the app went wrong ({type(error).__name__}: {error}). The robot was stopped and what "
                "was recorded is kept. The log on the console says more; please report it."
            )
