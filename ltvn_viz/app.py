"""The app's composition root: serves the page at once, and opens simulator, network and map behind it.

Owns that all of it is closed again. What is opened is `app_opening`, which is imported when somebody can see the page
already, because it brings the large libraries.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.shutdown_signals import stop_on_signals
from ltvn_viz.session.options import AppOptions

if TYPE_CHECKING:
    from ltvn_viz.session.session_loop import Session

__all__ = ["AppOptions", "RunningApp", "open_app", "run_app"]


@dataclass(frozen=True)
class RunningApp:
    """A page that is served; `session.run()` gives it life."""

    server: GuardedServer
    session: "Session"


def run_app(options: AppOptions, say: Callable[[str], None]) -> None:
    """Serve the page until interrupted; `say` gets the lines a person needs to open it. Raises LtvnError."""

    def tell(server: GuardedServer) -> None:
        say(f"Open {server.url}")
        say(f"From another machine, first: ssh -L {server.port}:127.0.0.1:{server.port} THIS_MACHINE")
        say("The scene is being loaded; the page shows it as soon as it is there…")

    with open_app(options, on_served=tell) as app, stop_on_signals(app.session.stop):
        say("Ready. Ctrl-C ends the app.")
        app.session.run()


@contextmanager
def open_app(
    options: AppOptions,
    *,
    seat: DriverSeat | None = None,
    on_served: Callable[[GuardedServer], None] = lambda _: None,
) -> Iterator[RunningApp]:
    """Open everything an app needs and close it again; `on_served` is called when the page answers. Raises LtvnError.

    Until all is open, the page says that it is loading.
    """
    with ExitStack() as stack:
        server = stack.enter_context(GuardedServer(port=options.port, seat=seat, is_loading=True))
        on_served(server)
        from ltvn_viz.app_opening import open_session

        session = open_session(options, server, stack)
        server.end_loading()
        yield RunningApp(server, session)
