"""Live viewing: serves the file of a recording while it is written, to viewers that know the address.

Listens on 127.0.0.1, and answers only under a secret path and for its own Host. Rerun's own server lacks these checks,
so a page of another site could read it by DNS rebinding. Owns port and address. Writing the file never waits for a
viewer.
"""

import http.server
import logging
import re
import secrets
import threading
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import BinaryIO

from ltvn_core.errors import ServerError

_LOG = logging.getLogger(__name__)
_SECRET = secrets.token_urlsafe(16)
"""Secret path, the same for the whole process, so that later recordings have the same address."""
_ADDRESS = re.compile(r"http://127\.0\.0\.1:(?P<port>[1-9][0-9]{0,4})/[\w-]{16,64}/live\.rrd", re.ASCII)
_BLOCK_BYTES = 1 << 16
_LOOK_S = 0.1
"""Interval between two checks whether a watched file has grown, in seconds."""
_IDLE_S = 30.0
"""Time after which a silent or blocked connection is closed, in seconds."""


def live_address(port: int) -> str:
    """Return the address for Rerun viewers, as in `rerun ADDRESS` and `ltvn view ADDRESS`."""
    return f"http://127.0.0.1:{port}/{_SECRET}/live.rrd"


def port_of(address: str) -> int | None:
    """Return the port in the address of a live recording; None for any other address."""
    found = _ADDRESS.fullmatch(address)
    return None if found is None else int(found["port"])


def is_own_host(handler: http.server.BaseHTTPRequestHandler) -> bool:
    """Tell whether the Host of a request is this machine's loopback address, not another name that resolves to it."""
    port = handler.connection.getsockname()[1]
    return handler.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}")


class LiveServer:
    """Serves one growing file until it is finished. Raises ServerError when the port is taken."""

    def __init__(self, port: int, path: Path) -> None:
        """Listen on the port; the file need not exist yet."""
        self._finished = threading.Event()
        handler = partial(_Handler, f"/{_SECRET}/live.rrd", path, self._finished)
        try:
            self._server = _Server(("127.0.0.1", port), handler)
        except (OSError, OverflowError) as error:
            raise ServerError(
                f"Port {port} on 127.0.0.1 cannot be used for streaming ({error}); name another with --stream."
            ) from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="recording-live", daemon=True)

    def start(self) -> None:
        """Start answering requests."""
        self._thread.start()

    def close(self) -> None:
        """Release the port; connected viewers still receive the rest of the file."""
        self._finished.set()
        if self._thread.is_alive():
            self._server.shutdown()
        self._server.server_close()


class _Server(http.server.ThreadingHTTPServer):
    block_on_close = False

    def handle_error(self, request: object, client_address: object) -> None:
        """Log nothing, because viewers connect and disconnect often."""
        _LOG.debug("a viewer left", exc_info=True)


class _Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    timeout = _IDLE_S

    def __init__(self, place: str, file: Path, finished: threading.Event, *args: object) -> None:
        self._place = place
        self._file = file
        self._finished = finished
        super().__init__(*args)  # pyright: ignore[reportArgumentType]

    def do_GET(self) -> None:
        """Send the file, and its new data as it grows."""
        self.close_connection = True
        if not is_own_host(self):
            self.send_error(HTTPStatus.FORBIDDEN, "This server answers only on this machine.")
        elif not secrets.compare_digest(self.path.encode(), self._place.encode()):
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            with self._file.open("rb") as file:
                self._follow(file)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing, because paths contain the secret."""

    def _follow(self, file: BinaryIO) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "application/octet-stream")
        self.send_header("Transfer-Encoding", "chunked")
        self.send_header("Connection", "close")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        while True:
            is_finished = self._finished.is_set()  # Checked before reading, so that the last data is not missed.
            while block := file.read(_BLOCK_BYTES):
                self.wfile.write(b"%x\r\n%b\r\n" % (len(block), block))
            if is_finished:
                self.wfile.write(b"0\r\n\r\n")
                return
            self._finished.wait(_LOOK_S)
