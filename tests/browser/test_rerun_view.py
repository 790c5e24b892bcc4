"""A recording in the Rerun viewer, in a real browser: it opens, it is drawn, and nobody else hears or sees of it."""

import http.client
import io
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.error import URLError
from urllib.parse import urlsplit
from urllib.request import urlopen

import numpy as np
import psutil
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, Request, expect

from ltvn_core.data.recording.live_server import live_address
from ltvn_core.data.recording.viewer_server import ServedViewer, serve_viewer
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from ltvn_viz.session.recording_library import RerunViewers
from tests.browser.pages import draw_seldom
from tests.core.data.recording import example_recording
from tests.waiting import PATIENCE_MS, PATIENCE_S, until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedViewer]:
    """A small recording, served."""
    path: Path = tmp_path_factory.mktemp("view") / "small.rrd"
    example_recording.write(path)
    with serve_viewer(path) as served:
        yield served


def test_the_recording_is_drawn_and_no_request_leaves_the_machine(chromium: Browser, viewer: ServedViewer) -> None:
    page = chromium.new_page(viewport={"width": 450, "height": 300})
    draw_seldom(page)
    answered: list[str] = []
    sent: list[Request] = []
    page.on("response", lambda response: answered.append(response.url))
    page.on("request", lambda request: sent.append(request))
    page.goto(viewer.url)
    expect(page.locator("#wait")).to_contain_text("small.rrd: 10 images, 3 nodes, 2 edges, 1 query")

    _until(page, lambda: page.evaluate("document.body.dataset.shown === 'yes'"), "all of the recording was read")
    assert page.locator("progress").evaluate("bar => bar.value === bar.max")
    _until(page, lambda: _colours(page) > 500, "the canvas shows pictures")

    assert f"{viewer.url}re_viewer_bg.wasm" in answered
    assert f"{viewer.url}recording.rrd" in answered
    assert {urlsplit(url).hostname for url in answered if not url.startswith(("data:", "blob:"))} == {"127.0.0.1"}
    foreign = [r for r in sent if urlsplit(r.url).hostname not in ("127.0.0.1", None)]
    assert all(request.failure == "csp" for request in foreign), "the page's policy lets requests out"
    page.close()


def test_a_recording_is_watched_while_it_is_written(chromium: Browser, tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    about = {"scene": "demo", "config": {}, "fingerprint": "abc"}
    with (
        RecordingWriter(tmp_path / "live.rrd", **about, live_port=port) as writer,
        serve_viewer(live_address(port)) as live,
    ):
        writer.write_frame(example_recording.observation(0))
        page = chromium.new_page(viewport={"width": 450, "height": 300})
        draw_seldom(page)
        page.goto(live.url)
        _until(page, lambda: page.evaluate("document.body.dataset.open === 'yes'"), "the viewer opened the stream")
        for step in range(1, 10):
            writer.write_frame(example_recording.observation(step))
        _until(page, lambda: _colours(page) > 500, "the canvas shows pictures")
        page.close()


def test_only_the_secret_path_and_this_host_are_answered(viewer: ServedViewer) -> None:
    address = urlsplit(viewer.url)

    assert _status(viewer, address.path) == 200
    assert _status(viewer, "/") == 404
    assert _status(viewer, "/wrong/") == 404
    assert _status(viewer, "/wrong/recording.rrd") == 404
    assert _status(viewer, f"{address.path}../../etc/passwd") == 404
    assert _status(viewer, address.path, host="rebound.example") == 403
    assert _status(viewer, address.path, host=f"rebound.example:{address.port}") == 403


def test_the_page_serves_each_recording_once_until_it_closes(tmp_path: Path) -> None:
    example_recording.write(tmp_path / "a.rrd")
    with ExitStack() as stack:
        views = RerunViewers(stack)
        address = views.address(tmp_path / "a.rrd")
        assert views.address(tmp_path / "a.rrd") == address
        with urlopen(address) as answer:
            assert answer.status == 200
        with pytest.raises(RecordingError, match="gone"):
            views.address(tmp_path / "gone.rrd")
    with pytest.raises(URLError):
        urlopen(address)


def test_it_listens_on_the_loopback_only(viewer: ServedViewer) -> None:
    port = urlsplit(viewer.url).port
    listening = [c for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN]

    assert {c.laddr.ip for c in listening if c.laddr.port == port} == {"127.0.0.1"}


def _until(page: Page, holds: Callable[[], bool], what: str) -> None:
    until(holds, meanwhile=lambda: page.wait_for_timeout(250), explain=lambda: f"not so that {what}")


def _colours(page: Page) -> int:
    """Return how many colours the page shows; a page that is still loading has few."""
    picture = Image.open(io.BytesIO(page.screenshot(timeout=PATIENCE_MS))).convert("RGB")
    return len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0))


def _status(viewer: ServedViewer, path: str, host: str | None = None) -> int:
    address = urlsplit(viewer.url)
    connection = http.client.HTTPConnection("127.0.0.1", address.port or 0, timeout=PATIENCE_S)
    try:
        connection.request("GET", path, headers={} if host is None else {"Host": host})
        return connection.getresponse().status
    finally:
        connection.close()
