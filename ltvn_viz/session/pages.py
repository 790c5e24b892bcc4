"""What the pages ask for in viser's panels and scene, brought to the session from the seat or from an own view."""

from ltvn_viz.server.driver_seat import ClientId
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.commands import Command
from ltvn_viz.session.session_loop import Session


class SessionPages:
    """The pages of a server and the session they ask. Implements `ltvn_viz.page_layout.Pages`."""

    def __init__(self, server: GuardedServer, session: Session) -> None:
        """Bring what the pages of `server` ask for to `session`."""
        self._server, self._session = server, session

    def send(self, command: Command) -> None:
        """Ask for something from the driver's seat; the guard let nobody else through."""
        self._session.send(command)

    def send_from(self, viser_client: int, command: Command) -> None:
        """Ask for something from the seat if the page has it, or takes it, and in the page's own view if not."""
        asker = self._server.asker(viser_client)
        if asker.page is not None:
            self._session.send(command, watcher=None if asker.drives else asker.page)

    def number_of(self, viser_client: int) -> ClientId | None:
        """Return our number of a page by viser's."""
        return self._server.number_of(viser_client)

    def file_address(self, address: str) -> str:
        """Return the address of a served file as a picture in a panel may have it."""
        return self._server.file_address(address)

    def show_picture(self, jpeg: bytes) -> None:
        """Show all pages what the robot sees."""
        self._server.show_picture(jpeg)

    def tell_moment(self, message: str) -> None:
        """Tell all pages which moment is on show."""
        self._server.tell_moment(message)

    def tell_activity(self, message: str) -> None:
        """Tell all pages what the robot does by itself."""
        self._server.tell_activity(message)
