"""Connects the pages to the session: their drive sockets, and viser's panels and scene.

Both send actions of `WISHES`. Driving and stopping go through the seat.
"""

from ltvn_core.errors import OptionError
from ltvn_core.types import Twist
from ltvn_viz.server.drive_socket import DriveListener, Newest
from ltvn_viz.server.driver_seat import ClientId, StopReason
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.requests import RouteHandler
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.share_links import commands_from_link
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Command
from ltvn_viz.wishes.wish_table import Action, Value, command_for


def drive_listener(session: Session) -> DriveListener:
    """Return the listener of the drive socket, through which the session reacts at once."""

    def on_drive(_client: ClientId, _twist: Twist) -> None:
        session.wake()

    def on_stop(_client: ClientId | None, reason: StopReason) -> None:
        if reason in (StopReason.STOPPED, StopReason.TAKEN_OVER):
            session.send(c.StopRobot())
        session.wake()

    def on_action(_client: ClientId, action: Action, value: Value) -> None:
        if (command := command_for(action, value)) is not None:
            session.send(command)

    def on_link(_client: ClientId, query: str) -> None:
        try:
            asked = commands_from_link(query, session.state.debugger.words)
        except OptionError as error:
            asked = (c.ReportError(str(error)),)
        for command in asked:
            session.send(command)

    return DriveListener(
        on_drive=on_drive,
        on_stop=on_stop,
        on_action=on_action,
        on_link=on_link,
        on_absence=session.wake,
    )


class SessionPages:
    """The pages of a server and their session. Implements `ltvn_viz.page_layout.Pages`."""

    def __init__(self, server: GuardedServer, session: Session) -> None:
        """Forward the requests of the pages of `server` to `session`."""
        self._server = server
        self._session = session

    def send_upload(self, command: Command) -> None:
        """Send the command of an uploaded file; the guard accepts uploads of the driver only."""
        self._session.send(command)

    def ask(self, action: Action, value: Value = None) -> None:
        """Send a command from the driver's seat; the guard accepts no others."""
        if (command := command_for(action, value)) is not None:
            self._session.send(command)

    def stop_for(self, viser_client: int) -> None:
        """Stop the robot for a page, with the seat or without."""
        self._server.stop_for(viser_client)

    def file_address(self, address: str) -> str:
        """Return the address of a served file with the key that a picture in a panel needs."""
        return self._server.file_address(address)

    def add_route(self, prefix: str, handler: RouteHandler, *, ending: str) -> None:
        """Serve `prefix<number>.ending` from `handler(number)`, called in a worker thread."""
        self._server.add_route(prefix, handler, ending=ending)

    def tell(self, kind: Newest, message: str | bytes) -> None:
        """Send a message to all pages, in place of any waiting message of its kind."""
        self._server.tell(kind, message)

    @property
    def shows_scene(self) -> bool:
        """Whether any page shows the 3D scene."""
        return self._server.shows_scene
