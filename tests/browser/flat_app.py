"""The real page on a flat world, for browser tests: everything but simulator and network is the app's own."""

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.locobot_model import locobot_glb
from ltvn_viz.app_opening import open_page
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.page_layout import PageAssets, Painter
from ltvn_viz.server.driver_seat import IDLE_S, LEASE_S, DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.fine_tuning import FineTuning
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.flat_world import FlatWorld, two_rooms
from tests.viz.page_sockets import ANY_PACE
from tests.viz.session_harness import SessionHarness
from tests.viz.tiny_fine_tuning import TUNER, tiny_weights
from tests.waiting import PATIENCE_S, until

WAY = ((1.0, 1.0), (1.0, 2.0), (3.0, 2.0), (5.0, 2.0), (5.0, 3.2))
"""A tour through the door of the two rooms."""

FLOOR = Floor((0, 0), (6, 4))


@dataclass(frozen=True)
class FlatApp:
    """A page that is up and running."""

    server: GuardedServer
    harness: SessionHarness
    session: Session


@contextmanager
def serving(folder: Path, *, lease_s: float | None = 5.0, idle_s: float = IDLE_S) -> Iterator[FlatApp]:
    """Serve the page with a map of both rooms; recordings go into `folder`.

    A page drawn by software may stall for longer than the lease of a real one, which `None` stands for.
    """
    executor = ThreadPoolExecutor(1)
    fine_tuning = FineTuning(TUNER, tiny_weights(folder), executor)
    harness = SessionHarness(folder, world=two_rooms(), way=WAY, executor=executor, fine_tuning=fine_tuning)
    seat = DriverSeat(lease_s=LEASE_S if lease_s is None else lease_s, idle_s=idle_s)
    assets = PageAssets(LOCOBOT, locobot_glb(), lambda _name, _state: _glb(harness.world))
    with ExitStack() as stack:
        server = stack.enter_context(GuardedServer(seat=seat, pace=ANY_PACE))
        session = open_page(harness.state, server, stack, _Watched(harness, server), assets, FLOOR)
        thread = threading.Thread(target=session.run, name="session")
        thread.start()
        try:
            yield FlatApp(server, harness, session)
        finally:
            session.stop()
            thread.join(timeout=10)


def until_shown(app: FlatApp, holds: Callable[[Snapshot], bool], *, patience_s: float = PATIENCE_S) -> Snapshot:
    """Wait until what the page is told to show fulfils something, and return that."""

    def matching() -> Snapshot | None:
        now = app.harness.now if app.harness.shown else Snapshot()
        return now if holds(now) else None

    found = until(matching, patience_s=patience_s, explain=lambda: app.harness.now)
    assert found is not None
    return found


def navigate_far(app: FlatApp) -> None:
    """Start a query to the node farthest from the robot, and wait until the robot is on its way.

    The newest node would not do: where the robot was driven before, it stands there.
    """
    app.session.send(c.Ask(c.Action.GOAL, app.harness.far_node))
    until_shown(app, lambda now: now.mode is Mode.NAVIGATING)


class _Watched(Painter):
    """A painter whose newest snapshot the harness has too."""

    def __init__(self, harness: SessionHarness, server: GuardedServer) -> None:
        super().__init__(server.viser.atomic)
        self._harness = harness

    def publish(self, snapshot: Snapshot) -> None:
        self._harness.shown[:] = [snapshot]
        super().publish(snapshot)


def _glb(world: FlatWorld) -> bytes:
    parts = []
    for start, end in world.walls:
        along = end - start
        wall = trimesh.creation.box((float(np.hypot(*along)) + 0.1, 0.1, 0.4))
        wall.apply_transform(trimesh.transformations.rotation_matrix(np.arctan2(along[1], along[0]), (0, 0, 1)))
        wall.apply_translation([*(start + end) / 2, 0.2])
        parts.append(wall)
    exported = trimesh.Scene(parts).export(file_type="glb")
    assert isinstance(exported, bytes)
    return exported
