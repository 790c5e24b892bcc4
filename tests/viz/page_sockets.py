"""A page without a browser: its two sockets, opened by hand, and messages written by hand."""

import json
import secrets
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import msgspec
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection

from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.limits import Pace
from ltvn_viz.wishes.commands import Value
from tests.waiting import PATIENCE_S, until

ANY_PACE = Pace(messages_per_s=1e9, messages_at_once=1e9, bytes_per_s=1e12, bytes_at_once=1e12)
"""For tests that say by hand in seconds what pages say in minutes."""

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 3.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


@dataclass(frozen=True)
class PageSockets:
    """One page."""

    server: GuardedServer
    key: str
    drive: Connection
    panels: Connection
    client: viser.ClientHandle

    @property
    def number(self) -> int:
        """Number of the page at the driver's seat."""
        number = self.server._drive.client_of(self.key)
        assert number is not None
        return number

    def ask(self, action: str, value: Value = None) -> None:
        """Ask for an action."""
        self.drive.send(json.dumps({"type": "action", "action": action, "value": value}))

    def here(self) -> None:
        """Give a sign of life."""
        self.drive.send('{"type":"here"}')

    @contextmanager
    def staying(self) -> Iterator[threading.Event]:
        """Give signs of life as the page's script does, until the event is set."""
        silent = threading.Event()

        def live() -> None:
            while not silent.wait(0.05):
                self.here()

        thread = threading.Thread(target=live, daemon=True)
        thread.start()
        try:
            yield silent
        finally:
            silent.set()
            thread.join()

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Read and forget whatever the page is told, as a long stay needs: a page that never reads is given up."""
        with ThreadPoolExecutor(2) as pool:
            readers = [pool.submit(_read_all, socket) for socket in (self.drive, self.panels)]
            try:
                yield
            finally:
                self.drive.close()
                self.panels.close()
                for reader in readers:
                    reader.result()

    def say(self, message: dict[str, Any]) -> None:
        """Send a message to viser."""
        self.panels.send(msgspec.msgpack.encode(message))

    def set(self, uuid: str, value: object) -> None:
        """Use a control."""
        self.say({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def take_seat(self) -> None:
        """Sit down, whoever sat there."""
        self.ask("take_over")
        until(lambda: self.server.seat.state_of(self.number).driver == self.number)

    def settle(self) -> None:
        """Wait until everything that was said to viser before has been judged and carried out."""
        mark = secrets.randbelow(10**6) / 1000

        def look() -> None:
            # The app may turn the camera to the map at the same moment, so the page says again where it looks from.
            self.say(CAMERA | {"position": [mark, 0.0, 3.0]})
            time.sleep(0.02)

        until(lambda: self.client.camera.position[0] == mark, meanwhile=look)


@contextmanager
def open_sockets(server: GuardedServer) -> Iterator[PageSockets]:
    """Open both sockets of a page, as its script does, and close them at the end."""
    key = secrets.token_hex(16)
    known = set(server.viser.get_clients())
    with _socket(server, f"/drive?page={key}") as drive, _socket(server, f"/?page={key}", panels=True) as panels:
        panels.send(msgspec.msgpack.encode(CAMERA))
        until(lambda: set(server.viser.get_clients()) - known)
        until(lambda: server._drive.client_of(key))
        (number,) = set(server.viser.get_clients()) - known
        yield PageSockets(server, key, drive, panels, server.viser.get_clients()[number])


@contextmanager
def open_live_page(server: GuardedServer) -> Iterator[PageSockets]:
    """Open both sockets of a page that gives signs of life and reads what it is told, as a browser does."""
    with open_sockets(server) as page, page.reading(), page.staying():
        yield page


def _read_all(socket: Connection) -> None:
    with suppress(ConnectionClosed):
        for _ in socket:
            pass


def _socket(server: GuardedServer, path: str, *, panels: bool = False) -> ClientConnection:
    socket = connect(
        f"ws://127.0.0.1:{server.port}{path}",
        origin=f"http://127.0.0.1:{server.port}",  # type: ignore[arg-type]
        subprotocols=[f"viser-v{viser.__version__}"] if panels else None,  # type: ignore[list-item]
        open_timeout=PATIENCE_S,
        max_size=None,
        ping_interval=None,  # A busy machine may take longer to answer than the default allows.
    )
    socket.send(proof(server.token, panels=panels))
    return socket


def proof(token: str, *, panels: bool = False) -> str | bytes:
    """Return what a page says first on a socket: JSON to the app, MessagePack to viser."""
    said = {"type": "proof", "token": token}
    return msgspec.msgpack.encode(said) if panels else json.dumps(said)
