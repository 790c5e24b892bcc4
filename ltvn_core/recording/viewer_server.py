"""Serves one recording with Rerun's web viewer to this machine only.

Listens on 127.0.0.1, answers only under a random path and for its own Host, and forbids the page to talk to anybody
else. Owns the server; the viewer itself comes from `viewer_assets`, the page round it from `viewer_page`.
"""

import http.server
import logging
import re
import secrets
import shutil
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import NamedTuple

from ltvn_core.errors import RecordingError, ServerError
from ltvn_core.recording.file_check import check_file
from ltvn_core.recording.live_server import is_own_host, port_of
from ltvn_core.recording.rrd_contents import require_rrd
from ltvn_core.recording.this_machine import open_here
from ltvn_core.recording.viewer_assets import viewer_assets
from ltvn_core.recording.viewer_page import SCRIPT, RecordingContents, contents_of, viewer_page

_LOG = logging.getLogger(__name__)
_BLOCK_BYTES = 1 << 16
_ADDRESS = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")
_ANSWER_S = 5.0
"""Longest time until a run on this machine answers."""
_LIVE_TIMEOUT_S = 3600.0
"""A robot that stands writes nothing for long."""
_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data: blob:; worker-src 'self' blob:; font-src 'self' data:; base-uri 'none'; "
    "frame-ancestors 'none'; form-action 'none'"
)


class _Response(NamedTuple):
    kind: str
    content: Path | bytes | str
    """A file, bytes, or the address of a live recording."""
    gzipped: bool = False


class ServedViewer(NamedTuple):
    """A running viewer."""

    url: str
    """Where the page is; holds the secret."""
    ended: threading.Event

    def wait(self) -> None:
        """Wait until somebody interrupts the program."""
        self.ended.wait()


@contextmanager
def serve_viewer(path: Path | str, port: int = 0) -> Iterator[ServedViewer]:
    """Serve a recording in the Rerun web viewer on 127.0.0.1 while the block runs; port 0 takes a free one.

    In place of a file, `path` may be the address of a recording that is being written, see `live_server`; it is passed
    on from there. Raises RecordingError for a file or an address that is none, and ServerError when the port is taken.
    """
    live = _checked_live_address(str(path)) if _ADDRESS.match(str(path)) else None
    contents = RecordingContents("A recording that is being written")
    if live is None:
        path = Path(path)
        require_rrd(path)
        found = check_file(path)
        if not found.framing.finished:
            _LOG.warning("%s is cut or unfinished; the viewer shows what is whole.", path)
        elif found.damage is not None:
            _LOG.warning("%s is damaged (%s), and the viewer may show less or nothing of it.", path, found.damage)
        contents = contents_of(path)
        _LOG.info("%s", contents.text)
    token = secrets.token_urlsafe(16)
    source = Path(path) if live is None else live
    server = _bound(port, _responses(source, token, viewer_page(contents)))
    address = f"127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, name="recording-viewer", daemon=True)
    thread.start()
    ended = threading.Event()
    try:
        yield ServedViewer(f"http://{address}/{token}/", ended)
    finally:
        ended.set()
        server.shutdown()
        server.server_close()
        thread.join()


def _checked_live_address(address: str) -> str:
    """Return the address of a recording that is being written; raises RecordingError when there is none."""
    if port_of(address) is None:
        raise RecordingError(
            f"{address} is an address, and `ltvn view` opens only those that a run with --stream prints "
            "(http://127.0.0.1:PORT/SECRET/live.rrd). Download the recording and name the file."
        )
    try:
        open_here(address, _ANSWER_S).close()
    except OSError as error:
        raise RecordingError(
            f"Nothing is being recorded at {address} ({error}). Start a run with --stream and open the address that it "
            "prints."
        ) from error
    return address


def _responses(source: Path | str, token: str, page: str) -> Mapping[str, _Response]:
    assets = viewer_assets()
    return {
        f"/{token}/": _Response("text/html; charset=utf-8", page.encode()),
        f"/{token}/page.js": _Response("text/javascript", SCRIPT.encode()),
        f"/{token}/re_viewer.js": _Response("text/javascript", assets.script, gzipped=True),
        f"/{token}/re_viewer_bg.wasm": _Response("application/wasm", assets.module, gzipped=True),
        f"/{token}/recording.rrd": _Response("application/octet-stream", source),
    }


def _bound(port: int, responses: Mapping[str, _Response]) -> http.server.ThreadingHTTPServer:
    try:
        return http.server.ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, responses))
    except (OSError, OverflowError) as error:
        raise ServerError(f"Port {port} on 127.0.0.1 cannot be used ({error}); name another, or 0 for any.") from error


class _Handler(http.server.BaseHTTPRequestHandler):
    def __init__(self, responses: Mapping[str, _Response], *args: object) -> None:
        self._responses = responses
        super().__init__(*args)  # pyright: ignore[reportArgumentType]

    def do_GET(self) -> None:
        """Answer one of the few known paths."""
        if not is_own_host(self):
            self.send_error(HTTPStatus.FORBIDDEN, "This server answers only on this machine.")
        elif (response := self._responses.get(self.path)) is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif isinstance(response.content, str):
            self._pass_on(response.kind, response.content)
        else:
            self._send(response, response.content)

    def log_message(self, format: str, *args: object) -> None:
        """Stay quiet; paths hold the secret."""

    def _pass_on(self, kind: str, address: str) -> None:
        """Send what a live recording sends, for as long as it goes on."""
        try:
            # The address was checked: it leads to this machine.
            live = open_here(address, _LIVE_TIMEOUT_S)
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "Nothing is being recorded there now.")
            return
        with live:
            self.send_response(HTTPStatus.OK)
            self._send_headers(kind)
            while block := live.read1(_BLOCK_BYTES):
                self.wfile.write(block)

    def _send(self, response: _Response, content: Path | bytes) -> None:
        size = len(content) if isinstance(content, bytes) else content.stat().st_size
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Length", str(size))
        if response.gzipped:
            self.send_header("Content-Encoding", "gzip")
        self._send_headers(response.kind)
        if isinstance(content, bytes):
            self.wfile.write(content)
        else:
            with content.open("rb") as file:
                shutil.copyfileobj(file, self.wfile)

    def _send_headers(self, kind: str) -> None:
        self.send_header("Content-Type", kind)
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
