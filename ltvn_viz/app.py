"""The app's composition root: opens simulator, network, map and page, and puts them together.

Owns what is opened in which order, and that all of it is closed again. Who drives in which world is `staging`; this
adds the page.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np

from ltvn_core.errors import RecordingError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.locobot_model import locobot_glb
from ltvn_core.types import Pose
from ltvn_viz.app_setup import open_app_state
from ltvn_viz.layers.lights_and_camera import set_initial_camera
from ltvn_viz.layers.scene_assets import added_glb, floor_bounds, scene_glb
from ltvn_viz.page_layout import PageAssets, build_layout
from ltvn_viz.painter import Painter
from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.shutdown_signals import stop_on_signals
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.commands import OpenRecording
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.pages import SessionPages
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.socket_handlers import drive_listener
from ltvn_viz.session.viewpoint import latest_viewpoint
from ltvn_viz.timeline.run_moment import moment_of

__all__ = ["AppOptions", "RunningApp", "open_app", "run_app"]


UNKNOWN_FLOOR_M = 4.0
"""So much to each side of the robot is shown first where nobody knows the place."""

LEAST_FLOOR_M, ROUND_ABOUT_M = 1.0, 0.7
"""A drive is shown first with so much floor at least, and so much more on each side of it."""


@dataclass(frozen=True)
class RunningApp:
    """A page that is served; `session.run()` gives it life."""

    server: GuardedServer
    session: Session


def run_app(options: AppOptions, say: Callable[[str], None]) -> None:
    """Serve the page until interrupted; `say` gets the lines a person needs to open it. Raises LtvnError."""
    with open_app(options) as app, stop_on_signals(app.session.stop):
        port = app.server.port
        say(f"Open {app.server.url}")
        say(f"From another machine, first: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE")
        app.session.run()


@contextmanager
def open_app(options: AppOptions, *, seat: DriverSeat | None = None) -> Iterator[RunningApp]:
    """Open everything an app needs and close it again; raises LtvnError before anything is served."""
    with ExitStack() as stack:
        thumbnails = ThumbnailStore()
        state = open_app_state(options, stack, thumbnails)
        server = stack.enter_context(GuardedServer(port=options.port, seat=seat))
        server.add_route("/thumb/", thumbnails.get)
        robot = state.live.robot
        set_initial_camera(
            server.viser,
            *(floor_bounds(state.scene) or _driven_floor(state, options) or _floor_around(robot.drawn_pose)),
        )
        state.viewpoint = lambda: latest_viewpoint(server.viser.get_clients().values())
        screen = _Screen()
        session = Session(
            state,
            server.seat,
            screen.publish,
            absence=lambda: server.presence.absence,
            watchers=lambda: server.watchers,
        )
        parts = build_layout(
            server.viser,
            SessionPages(server, session),
            PageAssets(scene_glb, locobot_glb() if robot.spec.name == LOCOBOT.name else None, robot.spec, added_glb),
        )
        screen.painter = Painter(parts, server.viser.atomic)
        screen.painter.start()
        stack.callback(screen.painter.close)
        server.listen(drive_listener(session))
        if options.replay is not None:
            session.send(OpenRecording(options.replay, options.replay_at_s))
        yield RunningApp(server, session)


def _driven_floor(state: AppState, options: AppOptions) -> tuple[Pose, Pose] | None:
    """Return two corners (x_m, y_m) around drive and map of the recording to watch; None where it cannot be read."""
    if options.replay is None:
        return None
    try:
        replay = state.open_replay(options.replay)
    except RecordingError:  # Who opens it to be watched says what is wrong with it.
        return None
    places = np.concatenate([replay.course, moment_of(replay.timeline).graph.poses])[:, :2]
    if not len(places):
        return None
    low, high = places.min(axis=0), places.max(axis=0)
    margin = max(0.0, LEAST_FLOOR_M - float((high - low).max())) / 2 + ROUND_ABOUT_M
    return low - margin, high + margin


def _floor_around(pose: Pose) -> tuple[Pose, Pose]:
    """Return two corners (x_m, y_m) of a floor of which nothing is known but that a robot at `pose` (3,) is on it."""
    middle = np.nan_to_num(pose[:2])
    return middle - UNKNOWN_FLOOR_M, middle + UNKNOWN_FLOOR_M


class _Screen:
    """Joins session and painter, each of which needs the other first."""

    painter: Painter

    def publish(self, snapshot: Snapshot) -> None:
        self.painter.publish(snapshot)
