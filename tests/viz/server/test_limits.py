"""What whoever connects may use up at most: lines of the log, messages, and connections."""

import json
import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.sync.connection import Connection

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.limits import (
    EVERY_S,
    MAX_STRANGERS,
    Allowance,
    LimitedLog,
    Pace,
    PageBudget,
    TooManyMessagesError,
    quiet_logger,
)
from tests.viz.page_sockets import CAMERA, PageSockets, open_sockets
from tests.viz.server.test_driver_seat import Clock
from tests.waiting import PATIENCE_S, until


def test_a_flood_is_one_line_and_a_count(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    log = LimitedLog(logging.getLogger("flood"), clock=clock)
    for page in range(1000):
        log.log(logging.WARNING, "page %d stopped", page)
    clock.wait(EVERY_S)
    log.log(logging.WARNING, "page %d stopped", 7)
    assert [record.getMessage() for record in caplog.records] == [
        "page 0 stopped",
        "page 7 stopped (and 999 more like it before)",
    ]


MESSAGES = 30_000
"""Far more than a page has to say before it is closed."""
RELEASE = json.dumps({"type": "action", "action": "release", "value": None})
FLOODS: dict[str, tuple[str, str | bytes]] = {
    "signs of life": ("drive", '{"type":"here"}'),
    "actions": ("drive", RELEASE),
    "views": ("panels", msgspec.msgpack.encode(CAMERA)),
    "messages that no page sends": ("panels", msgspec.msgpack.encode({"type": "none"})),
}


@pytest.fixture
def pages() -> Iterator[tuple[GuardedServer, PageSockets, PageSockets]]:
    with (
        GuardedServer(seat=DriverSeat(lease_s=PATIENCE_S)) as server,
        open_sockets(server) as driver,
        open_sockets(server) as watcher,
    ):
        driver.take_seat()
        yield server, driver, watcher


@pytest.mark.parametrize("flood", FLOODS)
def test_a_page_that_floods_a_socket_loses_it_and_is_told_why(
    pages: tuple[GuardedServer, PageSockets, PageSockets], flood: str
) -> None:
    server, driver, watcher = pages
    name, message = FLOODS[flood]
    socket: Connection = getattr(watcher, name)
    reader = threading.Thread(target=_read_all, args=(socket,))
    reader.start()
    with pytest.raises(ConnectionClosed):
        _send_again_and_again(socket, message)
    reader.join()
    assert (socket.close_code, socket.close_reason) == (CloseCode.POLICY_VIOLATION, "too many messages")
    assert server.seat.state_of(driver.number).driver == driver.number
    driver.settle()
    if name == "drive":
        until(lambda: server._drive.client_of(watcher.key) is None)


def test_a_page_that_uses_everything_at_once_is_heard_for_as_long_as_it_stays() -> None:
    clock = Clock()
    budget = PageBudget(Pace(), clock)
    for _ in range(60_000):
        clock.wait(1 / 150)
        assert budget.count("x" * 200) == 0


def test_what_a_connection_held_back_for_20_s_comes_through_and_more_does_not() -> None:
    clock = Clock()
    budget = PageBudget(Pace(), clock)
    for _ in range(20 * 50):
        assert budget.count("x" * 200) == 0
    with pytest.raises(TooManyMessagesError):
        budget.count("x")


def test_an_upload_does_not_wait_and_bytes_without_end_do() -> None:
    clock = Clock()
    budget = PageBudget(Pace(), clock)
    assert [budget.count(bytes(512 * 1024)) for _ in range(64)] == [0] * 64
    assert [budget.count(bytes(2**24)) > 0 for _ in range(3)] == [False, False, True]


def test_what_is_used_up_comes_back_and_no_more_than_the_most_is_saved() -> None:
    clock = Clock()
    allowance = Allowance(per_s=2.0, most=3.0, clock=clock)
    assert allowance.take(4.0) == 0.5
    clock.wait(100.0)
    assert [allowance.take(3.0), allowance.take(1.0)] == [0.0, 0.5]


def _send_again_and_again(socket: Connection, message: str | bytes) -> None:
    for _ in range(MESSAGES):
        socket.send(message)


def _read_all(socket: Connection) -> None:
    with suppress(ConnectionClosed):
        for _ in socket:
            pass


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
