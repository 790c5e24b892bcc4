"""Connects the pages' drive sockets to the session; driving and stopping go through the seat."""

from ltvn_core.errors import OptionError
from ltvn_core.types import Twist
from ltvn_viz.server.drive_socket import DriveListener
from ltvn_viz.server.driver_seat import ClientId, StopReason
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.share_links import commands_from_link
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Action, Value
from ltvn_viz.wishes.wish_table import command_for


def drive_listener(session: Session) -> DriveListener:
    """Return the listener of the drive socket, through which the session reacts at once."""

    def on_drive(_client: ClientId, _twist: Twist) -> None:
        session.wake()

    def on_stop(_client: ClientId | None, reason: StopReason) -> None:
        if reason in (StopReason.STOPPED, StopReason.TAKEN_OVER):
            session.send(c.Ask(c.Action.STOP))
        session.wake()

    def on_action(_client: ClientId, action: Action, value: Value) -> None:
        session.send(command_for(action, value))

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
