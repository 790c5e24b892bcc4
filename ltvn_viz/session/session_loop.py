"""The session loop: runs commands, advances the robot's time, and publishes the result.

Owns the pace, and the handling of errors. A single thread runs `run`; every other thread may only `send`, `wake` and
`stop`. Activities are in `ltvn_viz.session.activities`; `command_handlers` finds the function of each command.
"""

import logging
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue

from ltvn_core.errors import LtvnError, OptionError, RobotError
from ltvn_core.navigation.events import Severity
from ltvn_viz.server.drive_socket import DriveListener
from ltvn_viz.server.driver_seat import Absence, DriverSeat, StopReason
from ltvn_viz.server.limits import LimitedLog
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import Activity, AppState
from ltvn_viz.session.command_handlers import function_of, handle
from ltvn_viz.session.live_run import TICK_S
from ltvn_viz.session.seeking import let_time_pass, show_now
from ltvn_viz.session.share_links import commands_from_link
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.snapshot_builder import SnapshotBuilder
from ltvn_viz.session.world_handlers import carry_out_changes, go_on_with_story
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode

logger = logging.getLogger(__name__)

QUEUE_LIMIT = 256
"""Largest number of waiting commands; more arrive only if the app is flooded, and are refused."""
UNSEEN_S = 1.0
"""Interval between two snapshots while no page is open, in seconds."""
STALL_S = 0.5
"""After a stall longer than this, the robot's time continues from where it stood instead of catching up."""


class Session:
    """The running app without its page."""

    def __init__(
        self,
        state: AppState,
        driver: DriverSeat,
        publish: Callable[[Snapshot], None],
        clock: Callable[[], float] = time.monotonic,
        *,
        absence: Callable[[], Absence | None] = lambda: None,
        is_seen: Callable[[], bool] = lambda: True,
    ) -> None:
        """Put the parts together; nothing runs before `run` or `tick`. `publish` must not block.

        `absence` returns the current time without any open page, or None while one is open and before the first one;
        `is_seen` tells whether one is open.
        """
        self.state = state
        """The state of the session; only its own thread may change it."""
        self._driver = driver
        self._publish = publish
        self._clock = clock
        self._snapshot_builder = SnapshotBuilder(clock)
        self._commands: deque[c.Command] = deque()
        self._absence = absence
        self._is_seen = is_seen
        self._flood_log = LimitedLog(logger)
        # A signal handler may stop the session while this thread waits: an Event could then wait for its own lock.
        self._wakes = SimpleQueue[None]()
        self._is_stopping = False
        self._unseen_until = float("-inf")
        for action in c.Action:
            function_of(action)  # A wrong name shows here, and no click loads a module.

    @property
    def listener(self) -> DriveListener:
        """The listener of the pages' drive sockets, through which the session reacts at once."""

        def on_stop(reason: StopReason) -> None:
            if reason in (StopReason.STOPPED, StopReason.TAKEN_OVER):
                self.send(c.Ask(c.Action.STOP))
            self.wake()

        def on_link(query: str) -> None:
            try:
                asked = commands_from_link(query, self.state.debugger.words)
            except OptionError as error:
                asked = (c.ReportError(str(error)),)
            for command in asked:
                self.send(command)

        return DriveListener(
            on_drive=lambda _: self.wake(),
            on_stop=on_stop,
            on_command=self.send,
            on_link=on_link,
            on_absence=self.wake,
        )

    def send(self, command: c.Command) -> None:
        """Send a command, from any thread; never blocks."""
        # A stop that does not follow another is accepted even if the queue is full.
        is_fresh_stop = _is_stop(command) and not _is_stop(next(reversed(self._commands), None))
        if len(self._commands) < QUEUE_LIMIT or is_fresh_stop:
            self._commands.append(command)
        else:
            self._flood_log.log(logging.WARNING, "too many commands at once; left out %s", command)
        self.wake()

    def wake(self) -> None:
        """Let the session check commands and the driver now, not only at its next tick. Safe from any thread and from
        a signal handler."""
        self._wakes.put(None)

    def stop(self) -> None:
        """Let `run` return soon. Safe from any thread and from a signal handler."""
        self._is_stopping = True
        self.wake()

    def run(self, max_ticks: int | None = None) -> None:
        """Run in real time until `stop`, or for a number of ticks; then stop the robot and keep the recording."""
        ticks = 0
        due = self._clock()
        try:
            while not self._is_stopping and (max_ticks is None or ticks < max_ticks):
                self._sleep(max(0.0, due - self._clock()))
                self._guarded(self._react)
                if self._clock() < due:
                    continue  # Woken early: the command has been run, but the next tick is not due yet.
                self._guarded(self._advance)
                self._guarded(self._show)
                ticks += 1
                due = due + TICK_S if self._clock() - due < STALL_S else self._clock()
        finally:
            self.close()

    def _sleep(self, seconds: float) -> None:
        """Wait until somebody wakes the session, or for some seconds."""
        with suppress(Empty):
            self._wakes.get(timeout=seconds)
            for _ in range(self._wakes.qsize()):
                self._wakes.get_nowait()

    def tick(self) -> None:
        """Run commands, advance robot time by one tick, and publish: one round of `run`, without waiting."""
        self._guarded(self._react)
        self._guarded(self._advance)
        self._guarded(self._show)

    def close(self) -> None:
        """Stop the robot and keep the running recording."""
        self.state.live.robot.stop()
        self.state.cancel("The app is closing", "the app is closing")
        self.state.fine_tuning.cancel()
        self.state.making.close()
        self.state.worker.close()
        self._guarded(self.state.worker.collect)
        self.state.fine_tuning.close()
        self._guarded(self._keep_recording)

    def _keep_recording(self) -> None:
        kept = self.state.live.recorder.close()
        if kept is not None:
            logger.info("kept the recording %s", kept)

    def _react(self) -> None:
        """Run the waiting commands and pass held keys to the robot."""
        state = self.state
        while self._commands:
            handle(state, self._commands.popleft())
        _hold_without_pages(state, self._absence())
        self._driver.keep(kept=isinstance(state.activity, Navigation))
        twist = self._driver.current_twist()
        if twist is not None and state.steps_from:
            handle(state, c.Ask(c.Action.TAKE_OVER))
        if twist is not None and not isinstance(state.activity, Playback):
            show_now(state)  # Nobody may drive the robot by an image of the past.
        if twist is not None and state.open_loop:
            state.say(state.open_loop, Severity.WARN)
        state.teleop.handle(twist if state.activity is state.teleop else None)

    def _advance(self) -> None:
        """Advance robot time by a tick."""
        state = self.state
        _watch_link(state)
        if state.played is not None and state.played.is_waiting and self._is_seen():
            state.played.play()
        state.worker.collect()
        self._record()
        state.fine_tuning.collect()
        state.making.collect()
        if self._absence() is None or state.keeps_going:
            go_on_with_story(state)
        carry_out_changes(state)
        let_time_pass(state, TICK_S)
        if state.story is not None and state.story.is_waiting and _may_stand(state.activity):
            state.story.stand()  # A caption is read.
        else:
            state.activity.tick()
        _handle_breakpoint(state)
        if isinstance(state.activity, Navigation | MapBuilding) and state.activity.over:
            state.activity = state.teleop
        if state.worker.pending == 0:
            # The map does not change now, so the recording may draw it.
            now = state.live.robot.state()
            state.live.recorder.draw_graph(state.live_map.graph, now.step, now.stamp)

    def _record(self) -> None:
        """Let the recorder continue; file errors do not stop the driving."""
        state = self.state
        try:
            state.live.recorder.tick(map_is_still=state.worker.pending == 0)
        except LtvnError as error:
            state.say(str(error), Severity.ERROR, is_trouble=True)

    def _show(self) -> None:
        failure = self.state.live.recorder.take_failure()
        if failure is not None:
            self.state.say(failure, Severity.ERROR, is_trouble=True)
        if not self._is_seen() and self._clock() < self._unseen_until:
            return  # Nobody looks.
        self._unseen_until = self._clock() + UNSEEN_S
        self._guarded(self.state.live.renew_view)
        self._publish(self._snapshot_builder.build(self.state))

    def _guarded(self, part: Callable[[], None]) -> None:
        """Run a part of the loop; after an error the robot stops, the page shows the error, and the loop continues."""
        try:
            part()
        except LtvnError as error:
            link = self.state.link
            if link is not None and link.news is not None and isinstance(error, RobotError):
                self.state.drop()  # The error was reported before.
            else:
                self.state.fail(str(error))
        except Exception as error:
            logger.exception("the session failed")
            self.state.fail(
                f"Something in the app went wrong ({type(error).__name__}: {error}). The robot was stopped, and the "
                "recording is kept. The log on the console says more; please report it."
            )


def _is_stop(command: c.Command | None) -> bool:
    return isinstance(command, c.Ask) and command.action is c.Action.STOP


def _may_stand(activity: Activity) -> bool:
    return isinstance(activity, Navigation) and not activity.is_thinking


def _watch_link(state: AppState) -> None:
    """Report when the link to the robot breaks, which ends a query, and when it is restored."""
    news = None if state.link is None else state.link.look()
    if news is None:
        return
    if news.is_lost:
        state.cancel("The link broke", "the link to the robot broke")
    state.say(news.text, news.severity)


def _hold_without_pages(state: AppState, absence: Absence | None) -> None:
    """Pause a query while no page is open, unless a person wants it to continue."""
    query = state.activity
    if absence is None or state.keeps_going or not isinstance(query, Navigation):
        return
    if query.mode is Mode.NAVIGATING and not query.is_stopping:
        query.hold(f"Paused: the last page {absence.loss} at {absence.since:%H:%M}.")


def _handle_breakpoint(state: AppState) -> None:
    """Hold the query if a breakpoint was met since the last call."""
    stop = state.live.breakpoint_monitor.take_latest()
    if stop is None:
        return
    time_s, why = stop
    held = isinstance(state.activity, Navigation | Playback)
    if isinstance(state.activity, Navigation):
        state.activity.pause()
    how = "Stopped" if held else "Met"
    state.say(f"{how} at {time_s:.1f} s: {why}. “Stop when …” under “Why” shows it.", Severity.WARN)
    state.debugger.mark_stale()
