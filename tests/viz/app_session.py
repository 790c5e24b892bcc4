"""A session as the app opens it with options, without a page. Owns no assertion."""

from collections.abc import Callable
from contextlib import ExitStack

from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from tests.viz.session_harness import FakeDriver
from tests.waiting import until


class AppSession:
    """What the app leads, and what its pages would show."""

    def __init__(self, stack: ExitStack, options: AppOptions) -> None:
        """Open it until the stack closes."""
        self.state = open_app_state(options, stack)
        self.shown: list[Snapshot] = []
        self.session = Session(self.state, FakeDriver(), self.shown.append)
        stack.callback(self.session.close)

    @property
    def now(self) -> Snapshot:
        """What is on show."""
        return self.shown[-1]

    def do(self, *commands: c.Command, ticks: int = 1) -> Snapshot:
        """Send commands, let ticks pass, and return what is on show then; of several, each waits for the worker."""
        for command in commands:
            self.session.send(command)
        for _ in range(ticks):
            self.session.tick()
            if ticks > 1:
                self.state.worker.settle()
        return self.now

    def until(self, holds: Callable[[Snapshot], object]) -> Snapshot:
        """Let ticks pass until something holds, and return what is on show then."""
        self.session.tick()
        until(lambda: holds(self.now), meanwhile=self.session.tick, explain=lambda: self.now)
        return self.now
