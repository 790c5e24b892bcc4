"""Messages as notifications in the corner of every open page."""

from collections.abc import Callable, Iterable

import viser

from ltvn_core.navigation.events import Severity
from ltvn_viz.session.snapshot import Snapshot

TITLES = {Severity.INFO: "Note", Severity.WARN: "Not now", Severity.ERROR: "Problem"}
COLOURS = {Severity.INFO: (34, 139, 230), Severity.WARN: (250, 176, 5), Severity.ERROR: (250, 82, 82)}
SECONDS = {Severity.INFO: 8.0, Severity.WARN: 12.0, Severity.ERROR: 20.0}
"""Long enough to be read, for what is said here alone; a problem is shown in the panel afterwards."""


class Notifications:
    """Tells each message once, as soon as a page is open."""

    def __init__(self, clients: Callable[[], Iterable[viser.ClientHandle]]) -> None:
        """Tell whoever `clients` returns at that time."""
        self._clients = clients
        self._shown_number = 0

    def show(self, snapshot: Snapshot) -> None:
        """Tell the message of the snapshot, if it is a new one."""
        message = snapshot.message
        if message is None or message.number == self._shown_number:
            return
        clients = [*self._clients()]
        if not clients:
            return  # Who opens the page next reads it.
        self._shown_number = message.number
        for client in clients:
            client.add_notification(
                TITLES[message.severity],
                message.text,
                auto_close_seconds=SECONDS[message.severity],
                color=COLOURS[message.severity],
            )


class OwnNotices:
    """Tells one page what concerns its own view alone."""

    def __init__(self, client: viser.ClientHandle) -> None:
        """Tell `client`."""
        self._client = client
        self._shown = ("", 0)

    def show(self, snapshot: Snapshot) -> None:
        """Tell the notice of the page's own view, if it is a new one."""
        notice = snapshot.inspection.notice, snapshot.inspection.notice_number
        if notice == self._shown:
            return
        self._shown = notice
        if notice[0]:
            self._client.add_notification(
                TITLES[Severity.INFO],
                notice[0],
                auto_close_seconds=SECONDS[Severity.INFO],
                color=COLOURS[Severity.INFO],
            )
