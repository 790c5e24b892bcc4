"""The app's composition root: opens simulator, network, map and page, and puts them together.

Owns what is opened in which order, and that all of it is closed again. Who drives in which world is `staging`; this
adds the page.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from ltvn_core.sim.locobot import locobot_glb
from ltvn_viz.actions import listener
from ltvn_viz.commands import OpenRecording
from ltvn_viz.driving import DriverSeat
from ltvn_viz.options import AppOptions
from ltvn_viz.outlook import look_from_above
from ltvn_viz.painter import Painter
from ltvn_viz.scenery import floor_of, scene_glb
from ltvn_viz.screen import Assets, furnish
from ltvn_viz.server import GuardedServer
from ltvn_viz.session import Session
from ltvn_viz.signals import ended_by_signals
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.staging import open_stage
from ltvn_viz.thumbnails import Thumbnails
from ltvn_viz.viewpoint import newest

__all__ = ["App", "AppOptions", "opened", "run_app"]


@dataclass(frozen=True)
class App:
    """A page that is served; `session.run()` gives it life."""

    server: GuardedServer
    session: Session


def run_app(options: AppOptions, say: Callable[[str], None]) -> None:
    """Serve the page until interrupted; `say` gets the lines a person needs to open it. Raises LtvnError."""
    with opened(options) as app, ended_by_signals(app.session.stop):
        port = app.server.port
        say(f"Open {app.server.url}")
        say(f"From another machine, first: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE")
        app.session.run()


@contextmanager
def opened(options: AppOptions, *, seat: DriverSeat | None = None) -> Iterator[App]:
    """Open everything an app needs and close it again; raises LtvnError before anything is served."""
    with ExitStack() as stack:
        thumbnails = Thumbnails()
        stage = open_stage(options, stack, thumbnails)
        server = stack.enter_context(GuardedServer(port=options.port, seat=seat))
        server.add_route("/thumb/", thumbnails.get)
        if (floor := floor_of(stage.scene)) is not None:
            look_from_above(server.viser, *floor)
        stage.viewpoint = lambda: newest(server.viser.get_clients().values())
        screen = _Screen()
        session = Session(stage, server.seat, screen.publish)
        parts = furnish(server.viser, session.send, Assets(scene_glb, locobot_glb()))
        screen.painter = Painter(parts, server.viser.atomic)
        screen.painter.start()
        stack.callback(screen.painter.close)
        server.listen(listener(session))
        if options.replay is not None:
            session.send(OpenRecording(options.replay, options.replay_at_s))
        yield App(server, session)


class _Screen:
    """Joins session and painter, each of which needs the other first."""

    painter: Painter

    def publish(self, snapshot: Snapshot) -> None:
        self.painter.publish(snapshot)
