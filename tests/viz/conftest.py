"""What most tests of the app draw on."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import viser

from ltvn_viz.session.snapshot import Snapshot
from tests.viz.session_harness import SessionHarness


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    """A server without a browser."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def executor() -> Iterator[ThreadPoolExecutor]:
    """A thread for long jobs."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture
def gui(server: viser.ViserServer) -> viser.GuiApi:
    """Its panels."""
    return server.gui


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """A session in a flat world with a map of one room, in which nothing has happened yet."""
    harness = SessionHarness(tmp_path)
    harness.wait()
    return harness


@pytest.fixture
def snapshot(tmp_path: Path) -> Snapshot:
    """What the page shows of a flat world in which nothing has happened yet."""
    return SessionHarness(tmp_path).wait(2)
