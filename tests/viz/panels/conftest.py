"""What the tests of panels draw on."""

from collections.abc import Iterator

import pytest
import viser


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    """A server without a browser."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()
