"""Who has no token can neither fill the log nor use up the server's connections. Real sockets on a real server."""

import logging
import socket
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.limited_log import quiet_logger
from ltvn_viz.server.strangers import MAX_STRANGERS
from tests.viz.page_sockets import open_sockets
from tests.waiting import PATIENCE_S, until

SOCKET_REQUEST = (
    b"GET /drive HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@pytest.fixture(scope="module")
def server() -> Iterator[GuardedServer]:
    with GuardedServer() as server:
        yield server


def connect(server: GuardedServer) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)


def read_to_the_end(stranger: socket.socket) -> None:
    """Read until the other end closes, in whatever way."""
    try:
        while stranger.recv(1 << 16):
            pass
    except ConnectionResetError:
        pass


@pytest.mark.parametrize(
    "said",
    [
        pytest.param(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", id="a TLS handshake"),
        pytest.param(b"GET / HTTP/1.1\r\nHost: " + b"x" * 20_000 + b"\r\n\r\n", id="a long header"),
        pytest.param(b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 1000 + b"\r\n", id="many headers"),
        pytest.param(b"POST / HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc", id="a body"),
        pytest.param(SOCKET_REQUEST + b"\xff" * 100, id="no frame"),
        pytest.param(SOCKET_REQUEST + b"GET / HTTP/1.1\r\n\r\n", id="a request on a socket"),
    ],
)
def test_requests_that_break_the_protocol_leave_no_traceback_and_few_lines(
    server: GuardedServer, caplog: pytest.LogCaptureFixture, said: bytes
) -> None:
    with caplog.at_level(logging.INFO):
        for _ in range(20):
            with connect(server) as stranger:
                stranger.sendall(said.replace(b"%d", b"%d" % server.port))
                stranger.shutdown(socket.SHUT_WR)
                read_to_the_end(stranger)
        until(lambda: len(server._strangers) == 0)
    assert [record for record in caplog.records if record.exc_info] == []
    assert len(caplog.records) <= 3


def test_two_requests_at_once_leave_no_traceback(server: GuardedServer, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(300):  # `websockets` trips over one of fifty.
        with connect(server) as stranger:
            stranger.sendall(2 * b"GET / HTTP/1.1\r\nHost: elsewhere\r\n\r\n")
            read_to_the_end(stranger)
    assert [record for record in caplog.records if record.exc_info] == []
    assert len(caplog.records) <= 3


def test_what_the_library_writes_of_an_error_is_one_line_now_and_then(caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(100):
        try:
            raise AssertionError("not sent")
        except AssertionError:
            quiet_logger().error("went wrong in a test", exc_info=True)
    assert [record.getMessage() for record in caplog.records] == ["went wrong in a test: AssertionError not sent"]


def test_idle_connections_are_bounded_and_a_page_still_comes_in(
    server: GuardedServer, caplog: pytest.LogCaptureFixture
) -> None:
    with ExitStack() as idle:
        for _ in range(3 * MAX_STRANGERS):
            idle.enter_context(connect(server))
        with open_sockets(server) as page:
            page.take_seat()
            assert len(server._strangers) <= MAX_STRANGERS
            for _ in range(2 * MAX_STRANGERS):
                idle.enter_context(connect(server))
            page.ask("stop")
            page.settle()  # Who has shown the token is not among those that have to go.
    assert [record for record in caplog.records if record.exc_info] == []
    assert len(caplog.records) <= 3
