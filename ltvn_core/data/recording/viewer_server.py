"""Serves one recording with Rerun's web viewer to this machine only.

Listens on 127.0.0.1, answers only under a random path and for its own Host, and forbids the page to connect to other
servers. The viewer's files come from the installed wheel, so that no request leaves the machine: the `rerun` program
contains them, and is run once per version, on 127.0.0.1 only. Its home directory is then a new one, because the first
session of that program sends no usage data. The files are cached on disk.

For each image that it draws, the viewer loads only a few milliseconds' worth of a recording. With software rendering an
image takes most of a second, so a window would have half-filled views for a minute. Therefore the viewer loads in a
canvas of a few pixels behind the page's text, which is fast everywhere, and gets the window when it has finished.
"""

import gzip
import http.server
import logging
import os
import re
import secrets
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from html import escape
from http import HTTPStatus
from http.client import HTTPResponse
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import rerun as rr

from ltvn_core.cache_folder import cache_folder
from ltvn_core.data.recording.live_server import is_own_host, port_of
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrd_contents import require_rrd
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.errors import RecordingError, ServerError
from ltvn_core.navigation.events import QueryEnded
from ltvn_core.terminal_text import count_text

_LOG = logging.getLogger(__name__)
_SCRIPT, _MODULE = "re_viewer.js", "re_viewer_bg.wasm"
_START_S = 30.0
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>LTVN recording</title><link rel="icon" href="data:,">
<style>
  html, body {{ margin: 0; height: 100%; background: #18191c; color: #ccc; font: 16px sans-serif; overflow: hidden }}
  canvas {{ display: block; width: 100vw; height: 100vh }}
  body:not([data-shown]) canvas {{ position: absolute; width: 64px; height: 48px }}
  #wait {{ position: absolute; inset: 0; z-index: 1; display: grid; place-content: center; gap: 1em; padding: 1em }}
  #wait {{ background: #18191c; text-align: center }}
  progress {{ width: min(24em, 80vw); justify-self: center; accent-color: #4dabf7 }}
  button {{ justify-self: center; padding: 0.4em 1em; font: inherit }}
  [data-shown] #wait {{ display: none }}
</style></head>
<body{last_step}>
<main id="wait"><strong>{text}</strong>
<span id="doing" role="status">Loading the Rerun viewer; the first time takes some seconds.</span>
<progress aria-label="how much of the recording is read"></progress>
<button type="button" hidden>Show what is read</button></main>
<canvas id="viewer"></canvas>
<script src="re_viewer.js"></script><script src="page.js"></script></body></html>
"""
# The script uses WebHandle, which Rerun's own npm package wraps; its interface belongs to this version of the wheel.
SCRIPT = """
(async () => {
  const QUIET_MS = 20000; // Nobody shall look at these words for ever, whatever keeps the last step away.
  const [doing, bar, button] = ['#doing', 'progress', 'button'].map(name => document.querySelector(name));
  const last = 'lastStep' in document.body.dataset ? Number(document.body.dataset.lastStep) : null;
  let first = null, due = null;

  const show = () => { document.body.dataset.shown = 'yes' };
  const read = step => {
    first ??= step;
    doing.textContent = `Reading the recording: step ${step} of ${last}`;
    bar.max = Math.max(1, last - first);
    bar.value = step < last ? step - first : bar.max;
    clearTimeout(due);
    if (step >= last) show();
    else due = setTimeout(show, QUIET_MS);
  };
  const hear = ({type, time}) => {
    if (type === 'recording_open') {
      document.body.dataset.open = 'yes';
      doing.textContent = 'Reading the recording';
      button.hidden = false;
      if (last === null) show();
      else due = setTimeout(show, QUIET_MS);
    }
    if (type === 'time_update' && last !== null) read(time);
  };

  button.addEventListener('click', show);
  console.debug = () => {}; // The viewer writes ten thousands of lines there while it starts.
  try {
    await wasm_bindgen({module_or_path: 're_viewer_bg.wasm'});
    const handle = new wasm_bindgen.WebHandle({
      url: [new URL('recording.rrd', location.href).href],
      hide_welcome_screen: true, enable_history: false, notebook: false, persist: false, theme: 'dark',
      panel_state_overrides: {top: 'Hidden', blueprint: 'Collapsed', selection: 'Collapsed', time: 'Collapsed'},
      on_viewer_event: text => hear(JSON.parse(text)),
    });
    await handle.start(document.getElementById('viewer'));
  } catch (error) {
    doing.textContent = 'The viewer could not start: ' + error + '. It needs WebGL 2 or WebGPU.';
    bar.remove();
  }
})();
"""
_BLOCK_BYTES = 1 << 16
_ADDRESS = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")
_ANSWER_S = 5.0
"""Longest time in seconds until a run on this machine answers."""
_LIVE_TIMEOUT_S = 3600.0
"""Longest time in seconds without data, because a standing robot writes nothing for long."""
_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src 'self' data: blob:; worker-src 'self' blob:; font-src 'self' data:; base-uri 'none'; "
    "frame-ancestors 'none'; form-action 'none'"
)


def open_here(address: str, timeout_s: float) -> HTTPResponse:
    """Open an address on this machine. Raises OSError.

    Proxies from the environment are bypassed, because the address often contains a secret, and a proxy's 127.0.0.1 is
    another machine.
    """
    return urllib.request.build_opener(urllib.request.ProxyHandler({})).open(address, timeout=timeout_s)


class ViewerAssets(NamedTuple):
    """The two files of the web viewer, compressed with gzip, because the module has 43 MB uncompressed."""

    script: Path
    module: Path


def viewer_assets() -> ViewerAssets:
    """Return the files of the web viewer, from the cache if they are there.

    Raises ServerError if the installed Rerun does not contain them.
    """
    folder = cache_folder() / f"rerun-viewer-{rr.__version__}"
    assets = ViewerAssets(folder / f"{_SCRIPT}.gz", folder / f"{_MODULE}.gz")
    if not all(path.exists() for path in assets):
        _LOG.info("Unpacking the Rerun viewer (only once); this takes some seconds.")
        folder.mkdir(parents=True, exist_ok=True)
        with _served_by_rerun() as address:
            for name, path in zip((_SCRIPT, _MODULE), assets, strict=True):
                part = path.with_name(f"{path.name}.{os.getpid()}.part")
                part.write_bytes(gzip.compress(_fetched(f"{address}/{name}"), compresslevel=6))
                part.replace(path)
    return assets


@contextmanager
def _served_by_rerun() -> Iterator[str]:
    web = _free_port()
    command = [str(_program()), "--serve-web", "--bind=127.0.0.1", f"--port={_free_port()}", f"--web-viewer-port={web}"]
    with tempfile.TemporaryDirectory(prefix="ltvn-rerun-") as home:
        home_only = os.environ | {"HOME": home, "XDG_CONFIG_HOME": home, "XDG_CACHE_HOME": home}
        process = subprocess.Popen(
            command, env=home_only, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL
        )
        try:
            _wait_until_served(f"http://127.0.0.1:{web}", process)
            yield f"http://127.0.0.1:{web}"
        finally:
            process.terminate()
            process.wait()


def _wait_until_served(address: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            _fetched(address)
            return
        except ServerError:
            time.sleep(0.05)
    raise ServerError(
        f"The Rerun program did not start its web viewer within {_START_S:.0f} s; reinstall it with "
        f"`pip install --force-reinstall rerun-sdk=={rr.__version__}`."
    )


def _fetched(url: str) -> bytes:
    try:
        with open_here(url, _START_S) as answer:
            return answer.read()
    except OSError as error:
        raise ServerError(f"The Rerun program did not serve its web viewer ({error}); try again.") from error


def _program() -> Path:
    found = find_spec("rerun_cli")
    folder = Path(found.origin).parent if found is not None and found.origin else Path()
    program = folder / ("rerun.exe" if os.name == "nt" else "rerun")
    if not program.is_file():
        raise ServerError("The installed rerun-sdk has no `rerun` program; reinstall it with `pip install rerun-sdk`.")
    return program


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class RecordingContents(NamedTuple):
    """Description of a recording that is being loaded."""

    text: str
    last_step: int | None = None
    """Last step of the recording; None if it is unknown."""


def contents_of(path: Path) -> RecordingContents:
    """Read the description of a recording; only its file name if it is damaged or of another program."""
    try:
        recording = Recording.open(path)
    except RecordingError:
        return RecordingContents(path.name)
    graph = recording.final_graph()
    events = recording.events
    counts = {
        ("image", "images"): len(recording.frames),
        ("node", "nodes"): len(graph.nodes),
        ("edge", "edges"): len(graph.edges),
        ("query", "queries"): sum(isinstance(stamped.event, QueryEnded) for stamped in events),
    }
    held = ", ".join(count_text(count, *names) for names, count in counts.items() if count)
    steps = [*recording.poses.steps[-1:].tolist(), *(stamped.step for stamped in events[-1:])]
    return RecordingContents(f"{path.name}: {held or 'nothing'}", max(steps, default=None))


def viewer_page(contents: RecordingContents) -> str:
    """Return the viewer's page; its script is `SCRIPT`."""
    last_step = "" if contents.last_step is None else f' data-last-step="{contents.last_step}"'
    return _PAGE.format(text=escape(contents.text), last_step=last_step)


class _Response(NamedTuple):
    kind: str
    content: Path | bytes | str
    """A file, bytes, or the address of a live recording."""
    gzipped: bool = False


class ServedViewer(NamedTuple):
    """A running viewer."""

    url: str
    """Address of the page, with its secret."""
    ended: threading.Event

    def wait(self) -> None:
        """Wait until the user interrupts the program."""
        self.ended.wait()


@contextmanager
def serve_viewer(path: Path | str, port: int = 0) -> Iterator[ServedViewer]:
    """Serve a recording in the Rerun web viewer on 127.0.0.1 while the block runs; port 0 selects a free port.

    Instead of a file, `path` may be the address of a live recording, see `live_server`; its data is forwarded. Raises
    RecordingError for an invalid file or address, and ServerError if the port is taken.
    """
    live = _checked_live_address(str(path)) if _ADDRESS.match(str(path)) else None
    contents = RecordingContents("A recording that is being written")
    if live is None:
        path = Path(path)
        require_rrd(path)
        found = check_file(path)
        if not found.finished:
            _LOG.warning("%s is cut off or unfinished; the viewer shows the undamaged part.", path)
        elif found.damage is not None:
            _LOG.warning(
                "%s is damaged (%s), and the viewer may show only a part of it, or nothing.", path, found.damage
            )
        contents = contents_of(path)
        _LOG.info("%s", contents.text)
    token = secrets.token_urlsafe(16)
    source = Path(path) if live is None else live
    responses = _responses(source, token, viewer_page(contents))
    try:
        server = http.server.ThreadingHTTPServer(("127.0.0.1", port), partial(_Handler, responses))
    except (OSError, OverflowError) as error:
        raise ServerError(f"Port {port} on 127.0.0.1 cannot be used ({error}); name another, or 0 for any.") from error
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
    """Return the address of a live recording. Raises RecordingError if there is no live recording."""
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


class _Handler(http.server.BaseHTTPRequestHandler):
    def __init__(self, responses: Mapping[str, _Response], *args: object) -> None:
        self._responses = responses
        super().__init__(*args)  # pyright: ignore[reportArgumentType]

    def do_GET(self) -> None:
        """Answer a request for one of the known paths."""
        if not is_own_host(self):
            self.send_error(HTTPStatus.FORBIDDEN, "This server answers only on this machine.")
        elif (response := self._responses.get(self.path)) is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif isinstance(response.content, str):
            self._pass_on(response.kind, response.content)
        else:
            self._send(response, response.content)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing, because paths contain the secret."""

    def _pass_on(self, kind: str, address: str) -> None:
        """Forward a live recording while it grows."""
        try:
            # The address was checked: it is on this machine.
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
