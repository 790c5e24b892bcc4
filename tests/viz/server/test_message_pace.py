"""A page that never stops talking loses its socket, and the one that drives notices nothing. Real sockets."""

import json
import threading
from collections.abc import Iterator
from contextlib import suppress

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.sync.connection import Connection

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.message_pace import Allowance, Pace, PageBudget, TooManyMessagesError
from tests.viz.page_sockets import CAMERA, PageSockets, open_sockets
from tests.viz.server.test_driver_seat import Clock
from tests.waiting import PATIENCE_S, until

MESSAGES = 30_000
"""Far more than a page has to say before it is closed."""
RELEASE = json.dumps({"type": "action", "action": "release", "id": None})
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
