"""The web server of the app: viser behind an access check, on one port of this machine.

Owns the start of viser, the additional routes (`/drive`, numbered files), and the features of viser that are disabled
(moving to another port, public tunnels). viser has no hook for any of this, so its only call of `websockets` is wrapped
while it starts; the version is pinned, and tests check the wrapped call.

Uploads need no route: `viser.GuiApi.add_upload_button` travels over viser's own socket, which passes the same guard.
"""

import asyncio
import contextlib
import io
import json
import re
import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from types import FrameType
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from viser import _messages
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from ltvn_core.errors import ServerError
from ltvn_viz.server import page_messages
from ltvn_viz.server.drive_messages import MAX_MESSAGE_BYTES, ViewMessage
from ltvn_viz.server.drive_socket import MAX_PAGES, DriveListener, DriveSocket, Newest
from ltvn_viz.server.driver_seat import HERE_LEASE_S, ClientId, DriverSeat, Presence
from ltvn_viz.server.index_page import IndexPage
from ltvn_viz.server.limits import GuardedConnection, Pace, Strangers, quiet_logger
from ltvn_viz.server.page_gate import PageGate
from ltvn_viz.server.requests import (
    MAX_PROOF_BYTES,
    Proof,
    RouteHandler,
    Routes,
    is_loopback,
    is_websocket,
    not_found,
    refusal,
    refuse,
)
from ltvn_viz.server.sendable_messages import make_messages_sendable

DRIVE_PATH = "/drive"
VISER_PATH = "/"
READY_PREFIX = "/ready/"
"""Address of the current loading step as JSON, empty when loading is done; a page polls it before it opens its
sockets."""
MAX_VISER_SOCKETS = 2 * MAX_PAGES
"""Maximum number of viser's sockets; a page that reconnects may be counted twice until its old socket is closed."""
ASK_FOR_TOKEN = "Open the address that was printed in the terminal; it carries the token (#token=...)."
_PAGE_KEY = re.compile(r"[0-9a-f]{32}", re.ASCII)

_starting = threading.Lock()
"""Held while `websockets` is wrapped, so that two servers do not start through each other's wrapper."""


class GuardedServer:
    """Serves the page to holders of the token only."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        *,
        seat: DriverSeat | None = None,
        loading: str = "",
        pace: Pace | None = None,
    ) -> None:
        """Start the server; port 0 takes any free port. Raises ServerError.

        While `loading` is not empty, pages show it and wait for `end_loading`. A page that exceeds the limits of `pace`
        loses its socket.
        """
        if not is_loopback(host):
            raise ServerError(
                f"Refused to listen on {host}: everybody in the network could control the robot. Listen on 127.0.0.1 "
                "and reach it from another machine with: ssh -L PORT:127.0.0.1:PORT THIS_MACHINE"
            )
        listening = _bind(host, port)
        self.host = host
        self.port: int = listening.getsockname()[1]
        self.token = token or secrets.token_urlsafe(24)
        self.seat = seat or DriverSeat()
        # A seat with a longer lease of held inputs also allows longer silence of a page.
        self.presence = Presence(lease_s=HERE_LEASE_S if seat is None else seat.lease_s)
        self._drive = DriveSocket(self.seat, self.presence, pace=pace)
        self._routes = Routes()
        self._page = IndexPage()
        self._loading = loading
        self.gate = PageGate(self._drive.may_drive, pace)
        self._routes.add(READY_PREFIX, lambda _: json.dumps(self._loading).encode(), ending="json")
        self._proof = Proof(self.token)
        self._strangers = Strangers()
        self._files = ThreadPoolExecutor(max_workers=2, thread_name_prefix="page files")
        self.viser = self._start(listening)
        self.viser.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)

    @property
    def url(self) -> str:
        """Return the address to open, token included."""
        return self.link()

    def link(self, query: str = "") -> str:
        """Return the address to open, with the query of a link to a moment, and the token."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        # The token is in the fragment, which browsers do not send: it is in no request, log or referrer.
        return f"http://{host}:{self.port}/{query and '?'}{query}#token={self.token}"

    @property
    def scene(self) -> viser.SceneApi:
        """Return the 3D scene that all pages share."""
        return self.viser.scene

    @property
    def gui(self) -> viser.GuiApi:
        """Return the panels that all pages share."""
        return self.viser.gui

    def listen(self, listener: DriveListener) -> None:
        """Set the listener for driving, stops and actions."""
        self._drive.listener = listener

    def stop_for(self, viser_client: int) -> None:
        """Stop the robot for a page, with the seat or without. Safe from any thread."""
        self.seat.stop(self.number_of(viser_client))
        self._drive.settle()

    def number_of(self, viser_client: int) -> ClientId | None:
        """Convert viser's number of a page to its `ClientId`. Safe from any thread."""
        return self._drive.client_of(self.gate.key_of(viser_client))

    def add_route(self, prefix: str, handler: RouteHandler, *, ending: str = "jpg") -> None:
        """Serve `prefix<number>.ending`, as in `/thumb/17.jpg`, from `handler(number)`, called in a worker thread."""
        self._routes.add(prefix, handler, ending=ending)

    def file_address(self, address: str) -> str:
        """Return the address of a served file with the key that a picture in a panel needs."""
        return self._proof.file_address(address)

    def tell(self, kind: Newest, message: str | bytes) -> None:
        """Send a message to all pages, in place of any waiting message of its kind. Safe from any thread."""
        self._drive.tell_newest(kind, message)

    @property
    def shown(self) -> ViewMessage:
        """What any page shows."""
        return self._drive.shown

    def say_loading(self, step: str) -> None:
        """Show the current loading step on waiting pages. Safe from any thread."""
        self._loading = step

    def end_loading(self) -> None:
        """Allow waiting pages to open their sockets."""
        self._loading = ""

    def close(self) -> None:
        """Stop the robot and the server."""
        self._drive.close()
        with _silence():
            self.viser.stop()
        self._files.shutdown(wait=False, cancel_futures=True)

    def __enter__(self) -> Self:
        """Return the server, which is already running."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the server."""
        self.close()

    def _start(self, listening: socket.socket) -> viser.ViserServer:
        """Start viser on a bound socket, with all requests passed through the access check."""
        original = websockets.asyncio.server.serve
        make_messages_sendable()

        def serve(handler: Callable[..., Any], host: str, port: int, **options: Any) -> Any:
            options |= {"process_request": self._judge, "logger": quiet_logger(), "server_header": None}
            options["create_connection"] = partial(GuardedConnection, self._strangers)
            return original(self._router(handler), sock=listening, **options)

        with _starting, _silence():
            websockets.asyncio.server.serve = serve
            try:
                server = viser.ViserServer(host=self.host, port=self.port, verbose=False)
            finally:
                websockets.asyncio.server.serve = original
        # Any page could ask for a public tunnel; without its handler the message is ignored.
        server._websock_server.unregister_handler(_messages.ShareUrlRequest)
        self.gate.guard(server)
        return server

    async def _judge(self, connection: GuardedConnection, request: Request) -> Response | None:
        """Answer a request; None accepts a websocket, whose first message must be the token."""
        if (refused := refusal(request)) is not None:
            return refused
        path = urlsplit(request.path).path
        if is_websocket(request.headers):
            # A large message is refused while it arrives, not after it was received.
            connection.protocol.max_message_size = MAX_PROOF_BYTES
            return None if path in (DRIVE_PATH, VISER_PATH) else not_found()
        if path in ("/", "/index.html"):
            return self._page.answer()  # It is the same for every start, so it needs no token.
        match = self._routes.find(path)
        if not self._proof.is_in(request, is_for_picture=match is not None and match.is_picture):
            return refuse(HTTPStatus.UNAUTHORIZED, ASK_FOR_TOKEN)
        if match is None:
            return not_found()
        # Reading a picture from disk must not delay a key press.
        return await asyncio.get_running_loop().run_in_executor(self._files, match.answer)

    def _router(self, viser_handler: Callable[..., Any]) -> Callable[..., Any]:
        async def route(connection: GuardedConnection) -> None:
            if not await self._proof.is_first_on(connection):
                return
            self._strangers.leave(connection)
            address = urlsplit("" if connection.request is None else connection.request.path)
            key = _page_key(address.query)
            if address.path == DRIVE_PATH:
                connection.protocol.max_message_size = MAX_MESSAGE_BYTES
                await self._drive.serve(connection, key)
            else:
                # viser's own limit is 50 MB.
                connection.protocol.max_message_size = page_messages.MAX_MESSAGE_BYTES
                await self._serve_panels(viser_handler, connection, key)

        return route

    async def _serve_panels(
        self, viser_handler: Callable[..., Any], connection: GuardedConnection, key: str | None
    ) -> None:
        if len(self.viser._websock_server._live_connections) >= MAX_VISER_SOCKETS:
            await connection.close(CloseCode.TRY_AGAIN_LATER, "too many pages")
            return
        await viser_handler(self.gate.page(connection, key))


def _page_key(query: str) -> str | None:
    """Return the secret that connects a page's two sockets; None for a page without one."""
    given = parse_qs(query).get("page", [""])[-1]
    return given if _PAGE_KEY.fullmatch(given) else None


def _bind(host: str, port: int) -> socket.socket:
    """Return a bound socket; raises ServerError if the port is in use. (viser would silently take the next free
    port.)"""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen()
    except (OSError, OverflowError) as error:
        listening.close()
        raise ServerError(
            f"Port {port} on {host} cannot be used ({error}). Is the app open already? "
            "Close the other program, or choose another port with --port N (--port 0 takes any free one)."
        ) from error
    return listening


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep viser from printing an address without the token, and from writing into `--json -`."""
    return contextlib.redirect_stdout(io.StringIO())


@contextmanager
def stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` at SIGINT, SIGTERM and SIGHUP, so that open files can be finished.

    After a SIGHUP, which nohup makes a program ignore, the previous handler is called at the end.
    """
    came: list[int] = []

    def handle(number: int, _frame: FrameType | None) -> None:
        came.append(number)
        stop()

    numbers = [signal.SIGINT, signal.SIGTERM]
    hang_up = getattr(signal, "SIGHUP", None)  # Windows has none.
    if hang_up is not None and signal.getsignal(hang_up) is not signal.SIG_IGN:
        numbers.append(hang_up)
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if hang_up in came and callable(end := before[hang_up]):
        end(hang_up, None)
