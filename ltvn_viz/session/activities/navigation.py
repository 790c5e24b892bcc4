"""Autonomous driving: runs the navigator, one control step at a time.

The navigator computes in the worker's thread; the session advances the robot's time only between computations. So a
computation never delays a command, and the robot does not move during it: the time of a simulator stands still, and a
robot on the wall clock is stopped as soon as the computation takes longer than a tick.
"""

from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from queue import SimpleQueue

from ltvn_core.errors import RobotError, RobotPausedError
from ltvn_core.navigation.events import Event, Tick
from ltvn_core.types import CONTROL_STEP_S, NodeId
from ltvn_viz.session.live_run import LiveRun
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes.modes import Mode


class Navigation:
    """One query."""

    def __init__(
        self,
        live: LiveRun,
        worker: Worker,
        goal: NodeId,
        query: Iterator[Event | Tick],
        *,
        cancel: Callable[[], None],
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        """Run the generator `query`.

        `cancel` ends it, with its last events, at the next pull; thread-safe. `prepare` is called at the end of each
        control step, before the image for the navigator is taken, and may move the robot.
        """
        self._live = live
        self._worker = worker
        self.goal = goal
        self._query = query
        self._cancel = cancel
        self._prepare = prepare
        self._events: SimpleQueue[Event] = SimpleQueue()
        self._thinking = False
        self._owed_s = 0.0
        self._step_ends_s = 0.0
        self._steps_left: int | None = None
        self.held_because = ""
        """Reason why the robot is stopped in the middle of a control step; empty if it is not."""
        self.is_stopping = False
        """Whether the query was cancelled and its last events have not arrived yet."""
        self.over = False
        """Whether the query has ended and the robot is free."""

    @property
    def mode(self) -> Mode:
        """Navigating, or paused."""
        return Mode.PAUSED if self._steps_left == 0 and not self.is_stopping else Mode.NAVIGATING

    @property
    def is_thinking(self) -> bool:
        """Whether the navigator computes, in the worker's thread."""
        return self._thinking

    def hold(self, because: str) -> None:
        """Stop at once, until someone resumes; `because` says why."""
        self.pause()
        self.held_because = because
        self._live.robot.hold()

    def pause(self) -> None:
        """Hold at the end of the control step under way."""
        self._steps_left = 0

    def resume(self) -> None:
        """Resume driving."""
        self._steps_left = None
        self.held_because = ""

    def step(self) -> None:
        """Do one control step, then hold."""
        self._steps_left = 1
        self.held_because = ""

    def cancel(self) -> None:
        """Stop the robot and end the query as cancelled, as soon as the current computation of the navigator ends."""
        self.is_stopping = True
        self._live.robot.stop()

    def tick(self) -> None:
        """Advance robot time by a tick, or let the navigator compute at the end of a control step."""
        self._drain()
        if self._thinking:
            self._live.robot.hold()
        if self._thinking or self.over:
            return
        try:
            self._go_on()
        except RobotPausedError:
            self._live.robot.hold()  # It obeys again after a moment without commands.

    def _go_on(self) -> None:
        if self.held_because and not self.is_stopping:
            self._live.robot.hold()
            return
        if self._owed_s > 0 and not self.is_stopping:
            self._move()
        if self.is_stopping or (self._owed_s <= 0 and self._steps_left != 0):
            self._think()
        elif self._owed_s <= 0:
            self._live.robot.hold()

    def _move(self) -> None:
        clock = self._live.robot.clock
        if clock.is_simulated:
            # The last tick takes all remaining time, so that rounding leaves no tiny rest of a control step.
            tick_s = self._live.tick_s
            duration = tick_s if self._owed_s > 1.5 * tick_s else self._owed_s
            clock.advance(duration)
            self._owed_s -= duration
        else:
            self._live.robot.renew()
            self._owed_s = self._step_ends_s - clock.now()
        if self._owed_s <= 0:
            self._live.capture()

    def _think(self) -> None:
        if self.is_stopping:
            self._cancel()
        else:
            self._prepare()
        with suppress(RobotError) if self.is_stopping else nullcontext():  # A query can end without the robot.
            self._live.capture()  # Events name images by their step, so the image comes first.
        if self._steps_left and not self.is_stopping:
            self._steps_left -= 1
        self._thinking = True
        self._worker.submit(self._pull, self._pulled)

    def _pull(self) -> bool:
        """Run the navigator to the end of its control step; return whether it continues. In the worker's thread."""
        for event in self._query:
            if isinstance(event, Tick):
                return True
            self._events.put(event)
        return False

    def _pulled(self, goes_on: bool) -> None:
        self._thinking = False
        self._drain()
        if self.is_stopping or not goes_on:
            self._live.robot.stop()
        self._owed_s = CONTROL_STEP_S
        self.over = not goes_on
        self._step_ends_s = self._live.robot.clock.now() + CONTROL_STEP_S

    def _drain(self) -> None:
        while not self._events.empty():
            self._live.emit(self._events.get())
