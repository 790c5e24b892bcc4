"""What a person does on the page that the app may change under their hands: wait for it, hold a key, choose an image.

Owns how a test acts without racing the session, the mapper and the painter, which run in threads of their own.
"""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Protocol

from playwright.sync_api import Page
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import GraphChanged
from ltvn_core.types import NodeId
from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.session.session_loop import Session
from ltvn_viz.wishes.modes import Mode
from tests.waiting import until

HOLD_S = 20.0
HOLDS = 5
"""So often a key is pressed anew where the page stalled for longer than the lease."""
EXCHANGED_MS = 10_000
"""An image that cannot be clicked for so long was probably exchanged for another."""

PRESSED_S = 30.0
"""A press that has no effect for this long is repeated, in seconds."""


class _Served(Protocol):
    @property
    def seat(self) -> DriverSeat: ...


class App(Protocol):
    """A page that is up and running, of whichever kind."""

    @property
    def server(self) -> _Served: ...
    @property
    def session(self) -> Session: ...


def wait_for_rest(app: App) -> None:
    """Wait until the robot is nobody's and the map is finished, so that what is read of either stays as it is."""
    state = app.session.state
    until(
        lambda: (
            app.session.state.activity.mode is Mode.TELEOP
            and not state.teleop.is_driven
            and not state.teleop.is_mapping
            and state.worker.pending == 0
        ),
        explain=lambda: f"{app.session.state.activity.mode}, {state.worker.pending} jobs",
    )


def wait_for_built_map(app: App) -> None:
    """Wait until a whole map was built, rather than grown image by image, and the robot is nobody's again."""

    def is_built() -> bool:
        changes = [stamped.event for stamped in app.session.state.live.timeline.events]
        return any(isinstance(event, GraphChanged) and event.delta.cause is Cause.BUILD for event in changes)

    until(is_built)
    wait_for_rest(app)


def click_goal_image(app: App, page: Page, choose: Callable[[Sequence[NodeId]], NodeId]) -> NodeId:
    """Click the image of the gallery that `choose` returns of those on offer, and return its node.

    The gallery is exchanged in the worker's thread when the map has grown: a place in it may mean another node by the
    time of the click, and a node may be gone. So the click goes by node, and the choice is made anew for a new gallery.
    """
    wait_for_rest(app)

    def clicked() -> list[NodeId]:
        offered = app.session.state.goals.gallery
        if not offered:
            return []
        goal = choose(offered)
        with suppress(PlaywrightTimeoutError):
            page.locator(f'.lt-gallery img[data-id="{goal}"]').first.click(timeout=EXCHANGED_MS)
            return [goal]
        return []

    return until(clicked, explain=lambda: f"on offer: {app.session.state.goals.gallery}")[0]


def hold_key(app: App, page: Page, key: str, holds: Callable[[], bool]) -> None:
    """Hold a key until something holds; press it anew where the page stalled for longer than the lease.

    A robot whose guard missed a command stands until the key was let go, so a hold without effect ends as well. The key
    counts as let go when the robot was told to stop and obeys again.
    """
    state = app.session.state

    def was_let_go() -> bool:
        return not state.teleop.is_driven and (state.link is None or state.link.report.stopped_because is None)

    for _ in range(HOLDS):
        page.keyboard.down(key)
        try:
            until(lambda: holds() or app.server.seat.current_twist() is not None)
            with suppress(AssertionError):
                until(lambda: holds() or app.server.seat.current_twist() is None, patience_s=HOLD_S)
        finally:
            page.keyboard.up(key)
        if holds():
            return
        until(was_let_go)
    raise AssertionError(f"holding {key} never did it: {app.server.seat.state_of(1)}")


def press(page: Page, name: str, took_effect: Callable[[], bool]) -> None:
    """Press a button until the press takes effect, because a page that stalls on a busy machine may lose one."""
    button = page.get_by_role("button", name=re.compile(f"^{name}"))

    def again() -> None:
        with suppress(PlaywrightTimeoutError):
            button.click(timeout=EXCHANGED_MS)
        with suppress(AssertionError):
            until(took_effect, patience_s=PRESSED_S)

    until(took_effect, meanwhile=again)
