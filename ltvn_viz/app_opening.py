"""What is put behind a page that is served already: simulator, network, map, session, and all that draws.

Owns what is opened in which order. Who drives in which world is `app_setup`. Takes seconds to import.
"""

from contextlib import ExitStack

import numpy as np

from ltvn_core.errors import RecordingError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.locobot_model import locobot_glb
from ltvn_core.types import Pose
from ltvn_viz.app_setup import open_app_state
from ltvn_viz.layers.first_view import Floor
from ltvn_viz.layers.scene_assets import added_glb, floor_bounds, scene_glb
from ltvn_viz.page_layout import PageAssets, build_layout
from ltvn_viz.painter import Painter
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.commands import OpenRecording
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.pages import SessionPages
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.share_links import question_commands
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.session.socket_handlers import drive_listener
from ltvn_viz.session.viewpoint import latest_viewpoint
from ltvn_viz.timeline.run_moment import moment_of

UNKNOWN_FLOOR_M = 4.0
"""So much to each side of the robot is shown first where nobody knows the place."""

LEAST_FLOOR_M, ROUND_ABOUT_M = 1.0, 0.7
"""A drive is shown first with so much floor at least, and so much more on each side of it."""


def open_session(options: AppOptions, server: GuardedServer, stack: ExitStack) -> Session:
    """Open everything behind the page of a server, to be closed by `stack`, and draw it there. Raises LtvnError."""
    thumbnails = ThumbnailStore()
    state = open_app_state(options, stack, thumbnails)
    server.add_route("/thumb/", thumbnails.get)
    server.add_route("/marks/", state.strips.rows_from, ending="json")
    robot = state.live.robot
    floor = floor_bounds(state.scene) or _driven_floor(state, options) or _floor_around(robot.drawn_pose)
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
        Floor(*floor),
    )
    screen.painter = Painter(parts, server.viser.atomic)
    screen.painter.start()
    stack.callback(screen.painter.close)
    server.listen(drive_listener(session))
    if options.replay is not None:
        asked = question_commands(options.replay_question, session.state.debugger.words)
        session.send(OpenRecording(options.replay, options.replay_at_s, asked))
    return session


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
