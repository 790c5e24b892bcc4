"""The door: who gets in, what is served, and what viser must not do. Real sockets on a real server."""

import http.client
import json
import queue
import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
from viser import _messages
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from ltvn_core.errors import ServerError
from ltvn_viz.server.drive_socket import DriveListener
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.viser_client import mended
from tests.waiting import PATIENCE_S

THUMB = b"\xff\xd8 a picture"


@pytest.fixture(scope="module")
def server() -> Iterator[GuardedServer]:
    with GuardedServer() as server:
        server.add_route("/thumb/", lambda number: THUMB if number == 17 else None)
        yield server


def get(server: GuardedServer, path: str, **headers: str) -> http.client.HTTPResponse:
    """Ask for a path with exactly these headers."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    connection.putrequest("GET", path, skip_host=True, skip_accept_encoding=True)
    for name, value in ({"Host": f"127.0.0.1:{server.port}"} | headers).items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    answer.body = answer.read()  # type: ignore[attr-defined]
    connection.close()
    return answer


def cookie(server: GuardedServer) -> str:
    """Return the cookie that a right token earns."""
    header = get(server, f"/?token={server.token}").getheader("Set-Cookie")
    assert header is not None
    return header.split(";")[0]


def open_socket(server: GuardedServer, path: str, *, origin: str | None, with_cookie: bool) -> ClientConnection:
    headers = {"Cookie": cookie(server)} if with_cookie else {}
    protocols = ["viser-v1.1.1"] if path == "/" else None
    return connect(
        f"ws://127.0.0.1:{server.port}{path}",
        origin=origin,  # type: ignore[arg-type]
        additional_headers=headers,
        subprotocols=protocols,  # type: ignore[arg-type]
        open_timeout=PATIENCE_S,
    )


def test_the_printed_address_earns_a_cookie_and_hides_the_token(server: GuardedServer) -> None:
    parts = urlsplit(server.url)
    answer = get(server, f"{parts.path}?{parts.query}")
    assert (answer.status, answer.getheader("Location")) == (303, "/")
    earned = answer.getheader("Set-Cookie") or ""
    assert "HttpOnly" in earned
    assert "SameSite=Strict" in earned


def test_a_link_keeps_what_it_asks_for_and_loses_the_token(server: GuardedServer) -> None:
    asked = "replay=a%26b.rrd&at=3&x=%0d%0aSet-Cookie:%20y"
    answer = get(server, f"/?{asked}&token={server.token}")
    assert answer.getheader("Location") == "/?replay=a%26b.rrd&at=3&x=%0D%0ASet-Cookie%3A+y"
    from_elsewhere = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate", "Sec_Fetch_Dest": "document"}
    page = get(server, f"/?token={server.token}&replay=%22%3E%3Cb%3E&at=3", **from_elsewhere)
    assert b"url=/?replay=%22%3E%3Cb%3E&amp;at=3" in page.body  # type: ignore[attr-defined]
    assert server.token.encode() not in page.body  # type: ignore[attr-defined]


def test_a_link_reaches_the_app_unless_somebody_else_drives(server: GuardedServer) -> None:
    heard: queue.Queue[str] = queue.Queue()
    server.listen(DriveListener(on_link=lambda _, query: heard.put(query)))
    with open_socket(server, "/drive", origin=f"http://127.0.0.1:{server.port}", with_cookie=True) as page:
        page.send(json.dumps({"type": "link", "query": "replay=a.rrd"}))
        assert heard.get(timeout=PATIENCE_S) == "replay=a.rrd"
        with open_socket(server, "/drive", origin=f"http://127.0.0.1:{server.port}", with_cookie=True) as other:
            other.send(json.dumps({"type": "link", "query": "replay=b.rrd"}))
            while json.loads(other.recv(timeout=PATIENCE_S))["type"] != "refused":
                pass
    assert heard.empty()


@pytest.mark.parametrize("path", ["/", "/thumb/17.jpg", "/assets/x.js", "/?token=wrong"])
def test_nothing_is_served_without_the_token(server: GuardedServer, path: str) -> None:
    assert get(server, path).status == 401


@pytest.mark.parametrize("path", ["/", "/thumb/17.jpg"])
def test_another_host_name_is_refused_even_with_the_token(server: GuardedServer, path: str) -> None:
    for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1.evil.example"):
        assert get(server, path, Host=host, Cookie=cookie(server)).status == 403


def test_another_origin_is_refused_even_with_the_token(server: GuardedServer) -> None:
    assert get(server, "/thumb/17.jpg", Origin="http://evil.example", Cookie=cookie(server)).status == 403


@pytest.mark.parametrize("path", ["/", "/drive"])
def test_a_socket_needs_cookie_and_origin(server: GuardedServer, path: str) -> None:
    own = f"http://127.0.0.1:{server.port}"
    for origin, with_cookie in (("http://evil.example", True), (None, True), (own, False), ("null", True)):
        with pytest.raises(InvalidStatus):
            open_socket(server, path, origin=origin, with_cookie=with_cookie)
    with open_socket(server, path, origin=own, with_cookie=True) as opened:
        assert opened.recv(timeout=PATIENCE_S)


def test_the_page_asks_for_nothing_from_outside_and_may_not_be_framed(server: GuardedServer) -> None:
    answer = get(server, "/", Cookie=cookie(server))
    policy = answer.getheader("Content-Security-Policy") or ""
    assert "default-src 'self'" in policy or "default-src 'none'" in policy
    assert "http:" not in policy
    assert "https:" not in policy
    assert answer.getheader("X-Frame-Options") == "DENY"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"


def test_a_numbered_image_is_served(server: GuardedServer) -> None:
    answer = get(server, "/thumb/17.jpg", Cookie=cookie(server))
    assert (answer.status, answer.body) == (200, THUMB)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "path",
    ["/thumb/18.jpg", "/thumb/../../etc/passwd", "/thumb/%2e%2e%2fx.jpg", "/thumb/17.jpg/x", "/thumb/-1.jpg", "/etc"],
)
def test_any_other_path_is_not_found(server: GuardedServer, path: str) -> None:
    assert get(server, path, Cookie=cookie(server)).status == 404


def test_no_page_can_open_a_public_tunnel(server: GuardedServer) -> None:
    handlers = server.viser._websock_server._incoming_handlers
    assert not handlers.get(_messages.ShareUrlRequest)


def test_a_taken_port_is_said_and_not_silently_changed(server: GuardedServer) -> None:
    with pytest.raises(ServerError, match=f"Port {server.port}.*--port"):
        GuardedServer(port=server.port)


def test_listening_to_the_network_is_refused() -> None:
    with pytest.raises(ServerError, match=r"ssh -L"):
        GuardedServer(host="0.0.0.0")


@pytest.mark.parametrize("message", ["{", "x" * 5000, '{"type": "drive"}', b"\x00\xff"])
def test_an_invalid_message_closes_only_its_own_socket(server: GuardedServer, message: str | bytes) -> None:
    own = f"http://127.0.0.1:{server.port}"
    with (
        open_socket(server, "/drive", origin=own, with_cookie=True) as good,
        open_socket(server, "/drive", origin=own, with_cookie=True) as bad,
    ):
        bad.recv(timeout=PATIENCE_S)
        bad.send(message)
        with pytest.raises(ConnectionClosed):
            list(bad)  # Reads what is still under way until the other end closes.
        good.send(json.dumps({"type": "action", "action": "stop", "id": None}))
        assert any(json.loads(good.recv(timeout=PATIENCE_S))["reason"] == "stopped" for _ in range(3))


def test_only_this_machine_can_reach_the_port(server: GuardedServer) -> None:
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in others - {"127.0.0.1", "127.0.1.1"}:
        with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
            socket.create_connection((str(address), server.port), timeout=2)


def test_a_page_that_comes_while_the_app_is_loading_is_shown_and_told_to_wait() -> None:
    with GuardedServer(is_loading=True) as server:
        key = cookie(server)
        page = get(server, "/", Cookie=key)
        before = get(server, "/ready/0.json", Cookie=key)
        server.end_loading()
        after = get(server, "/ready/0.json", Cookie=key)
    assert b"Loading scene" in page.body  # type: ignore[attr-defined]
    assert [json.loads(each.body) for each in (before, after)] == [False, True]  # type: ignore[attr-defined]


def test_pictures_reach_pages_that_are_there_and_the_newest_one_those_that_come(server: GuardedServer) -> None:
    here = f"http://127.0.0.1:{server.port}"
    with open_socket(server, "/drive", origin=here, with_cookie=True) as early:
        early.recv(timeout=PATIENCE_S)
        server.show_picture(b"a jpeg")
        assert next(said for said in iter(lambda: early.recv(timeout=PATIENCE_S), None) if isinstance(said, bytes))
    with open_socket(server, "/drive", origin=here, with_cookie=True) as late:
        said = [late.recv(timeout=PATIENCE_S) for _ in range(2)]
    assert b"a jpeg" in said


def test_a_page_of_another_viser_is_refused_rather_than_served_unmended() -> None:
    with pytest.raises(RuntimeError, match="another page"):
        mended("<html><body>a viser to come</body></html>")
