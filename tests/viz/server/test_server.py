"""The door: who gets in, what is served, and what viser must not do. Real sockets on a real server."""

import http.client
import json
import queue
import re
import socket
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import pytest
import zstandard
from viser import _messages
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import CloseCode
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from ltvn_core.errors import ServerError
from ltvn_viz.server.drive_socket import DriveListener, Newest
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.index_page import SCRIPTS, STATIC, mended
from ltvn_viz.server.requests import REFUSED_CODE, Proof
from ltvn_viz.session.saved_files import SAVED_ENDING, SAVED_PREFIX, SavedFiles
from tests.viz.page_sockets import CAMERA, proof
from tests.waiting import PATIENCE_S, until

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


def shown(server: GuardedServer) -> dict[str, str]:
    """Return the header by which the page's script shows the token."""
    return {"Authorization": f"Bearer {server.token}"}


@contextmanager
def open_socket(
    server: GuardedServer, path: str, *, origin: str | None = None, first: str | bytes | None = None
) -> Iterator[Connection]:
    """Open a socket as the page does, and say `first`: the token if nothing else is given, nothing if it is empty."""
    with connect(
        f"ws://127.0.0.1:{server.port}{path}",
        origin=origin or f"http://127.0.0.1:{server.port}",  # type: ignore[arg-type]
        subprotocols=["viser-v1.1.1"] if path == "/" else None,  # type: ignore[list-item]
        open_timeout=PATIENCE_S,
    ) as socket:
        if first != "":
            socket.send(proof(server.token, panels=path == "/") if first is None else first)
        yield socket


def test_the_token_stands_where_no_browser_sends_it(server: GuardedServer) -> None:
    parts = urlsplit(server.link("replay=a.rrd&at=3"))
    assert (parts.path, parts.query, parts.fragment) == ("/", "replay=a.rrd&at=3", f"token={server.token}")
    assert urlsplit(server.url).query == ""


def test_the_page_shows_nothing_of_a_session_and_leaves_no_cookie(server: GuardedServer) -> None:
    with GuardedServer() as other:
        answers = [get(each, "/") for each in (server, other)]
    bodies = [answer.body for answer in answers]  # type: ignore[attr-defined]
    nonces = [re.findall(rb'nonce="([^"{]+)"', body)[0] for body in bodies]
    assert bodies[0].replace(nonces[0], b"") == bodies[1].replace(nonces[1], b"")
    assert server.token.encode() not in bodies[0]
    assert [answer.getheader("Set-Cookie") for answer in answers] == [None, None]


def test_a_link_reaches_the_app_unless_somebody_else_drives(server: GuardedServer) -> None:
    heard: queue.Queue[str] = queue.Queue()
    server.listen(DriveListener(on_link=heard.put))
    with open_socket(server, "/drive") as page:
        page.send(json.dumps({"type": "link", "query": "replay=a.rrd"}))
        assert heard.get(timeout=PATIENCE_S) == "replay=a.rrd"
        with open_socket(server, "/drive") as other:
            other.send(json.dumps({"type": "link", "query": "replay=b.rrd"}))
            while json.loads(other.recv(timeout=PATIENCE_S))["type"] != "refused":
                pass
    assert heard.empty()


@pytest.mark.parametrize("path", ["/thumb/17.jpg", "/ready/0.json", "/assets/x.js"])
def test_no_file_is_served_without_the_token(server: GuardedServer, path: str) -> None:
    assert get(server, path).status == 401
    assert get(server, path, Authorization="Bearer wrong").status == 401
    assert get(server, path, Cookie=f"ltvn_{server.port}={server.token}").status == 401
    assert get(server, f"{path}?token={server.token}").status == 401
    assert get(server, f"{path}?key={server.token}").status == 401


@pytest.mark.parametrize("path", ["/", "/thumb/17.jpg"])
def test_another_host_name_is_refused_even_with_the_token(server: GuardedServer, path: str) -> None:
    for host in ("evil.example", f"evil.example:{server.port}", "127.0.0.1.evil.example"):
        answer = get(server, path, Host=host, **shown(server))
        assert answer.status == 403
        assert b"ssh -L" in answer.body  # type: ignore[attr-defined]


def test_another_origin_is_refused_even_with_the_token(server: GuardedServer) -> None:
    assert get(server, "/thumb/17.jpg", Origin="http://evil.example", **shown(server)).status == 403


@pytest.mark.parametrize("path", ["/", "/drive"])
@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null"])
def test_a_socket_from_another_origin_is_refused_even_with_the_token(
    server: GuardedServer, path: str, origin: str
) -> None:
    with pytest.raises(InvalidStatus), open_socket(server, path, origin=origin):
        pass


@pytest.mark.parametrize("path", ["/", "/drive"])
def test_a_socket_hears_nothing_before_the_token_was_shown(server: GuardedServer, path: str) -> None:
    for wrong in (
        proof("wrong", panels=path == "/"),
        json.dumps({"type": "action", "action": "stop", "value": None}),
        msgspec.msgpack.encode(CAMERA),
        b"\xc1",
        "[" * 4000,
        "x" * 5000,
    ):
        with open_socket(server, path, first=wrong) as refused:
            assert list(refused_words(refused)) == []
            assert refused.close_code in (REFUSED_CODE, CloseCode.MESSAGE_TOO_BIG)
    with open_socket(server, path) as opened:
        assert opened.recv(timeout=PATIENCE_S)


@pytest.mark.parametrize("path", ["/", "/drive"])
def test_a_socket_on_which_nothing_is_said_is_closed(path: str) -> None:
    with GuardedServer() as impatient:
        impatient._proof = Proof(impatient.token, within_s=0.0)
        with open_socket(impatient, path, first="") as late:
            assert list(refused_words(late)) == []
            assert late.close_code == REFUSED_CODE


def refused_words(socket: Connection) -> Iterator[str | bytes]:
    """Return what a socket says until the other end closes it."""
    try:
        while True:
            yield socket.recv(timeout=PATIENCE_S)
    except ConnectionClosed:
        return


def test_the_page_asks_for_nothing_from_outside_and_may_not_be_framed(server: GuardedServer) -> None:
    answer = get(server, "/", **shown(server))
    policy = answer.getheader("Content-Security-Policy") or ""
    assert "default-src 'self'" in policy or "default-src 'none'" in policy
    assert "http:" not in policy
    assert "https:" not in policy
    assert answer.getheader("X-Frame-Options") == "DENY"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"


def test_a_numbered_image_is_served(server: GuardedServer) -> None:
    answer = get(server, "/thumb/17.jpg", **shown(server))
    in_a_panel = get(server, "/" + server.file_address("/thumb/17.jpg"))
    for each in (answer, in_a_panel):
        assert (each.status, each.body) == (200, THUMB)  # type: ignore[attr-defined]
    assert server.token not in server.file_address("/thumb/17.jpg")


def test_a_saved_file_is_handed_out_for_the_token_alone_and_by_its_number_alone(
    server: GuardedServer, tmp_path: Path
) -> None:
    files, written = SavedFiles(), tmp_path / "moment.rrd"
    written.write_bytes(b"a moment")
    server.add_route(SAVED_PREFIX, files.read, ending=SAVED_ENDING)
    address, again = files.offer(written).address, files.offer(written).address
    answer = get(server, address, **shown(server))
    assert (answer.status, answer.body) == (200, b"a moment")  # type: ignore[attr-defined]
    assert get(server, address).status == 401
    assert get(server, "/" + server.file_address(address)).status == 401
    assert address != again
    assert get(server, f"{SAVED_PREFIX}0.{SAVED_ENDING}", **shown(server)).status == 404
    assert get(server, f"{SAVED_PREFIX}moment.rrd", **shown(server)).status == 404
    written.unlink()
    assert get(server, address, **shown(server)).status == 404


@pytest.mark.parametrize(
    "path",
    ["/thumb/18.jpg", "/thumb/../../etc/passwd", "/thumb/%2e%2e%2fx.jpg", "/thumb/17.jpg/x", "/thumb/-1.jpg", "/etc"],
)
def test_any_other_path_is_not_found(server: GuardedServer, path: str) -> None:
    assert get(server, path, **shown(server)).status == 404


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
    with open_socket(server, "/drive") as good, open_socket(server, "/drive") as bad:
        bad.recv(timeout=PATIENCE_S)
        bad.send(message)
        with pytest.raises(ConnectionClosed):
            list(bad)  # Reads what is still under way until the other end closes.
        good.send(json.dumps({"type": "action", "action": "stop", "value": None}))
        said = iter(lambda: json.loads(good.recv(timeout=PATIENCE_S)), None)
        assert any(each.get("reason") == "stopped" for each in said)


def test_only_this_machine_can_reach_the_port(server: GuardedServer) -> None:
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in others - {"127.0.0.1", "127.0.1.1"}:
        with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
            socket.create_connection((str(address), server.port), timeout=2)


def test_a_page_that_comes_while_the_app_is_loading_is_told_at_what_it_is() -> None:
    with GuardedServer(loading="Loading") as server:
        page = get(server, "/")
        before = get(server, "/ready/0.json", **shown(server))
        server.say_loading("Starting “it”")
        meanwhile = get(server, "/ready/0.json", **shown(server))
        server.end_loading()
        after = get(server, "/ready/0.json", **shown(server))
    assert b"ltvn-loading-text" in page.body  # type: ignore[attr-defined]
    answers = [json.loads(each.body) for each in (before, meanwhile, after)]  # type: ignore[attr-defined]
    assert answers == ["Loading", "Starting “it”", ""]


def test_pictures_reach_pages_that_are_there_and_the_newest_one_those_that_come(server: GuardedServer) -> None:
    with open_socket(server, "/drive") as early:
        early.recv(timeout=PATIENCE_S)
        server.tell(Newest.PICTURE, b"a jpeg")
        assert next(said for said in iter(lambda: early.recv(timeout=PATIENCE_S), None) if isinstance(said, bytes))
    with open_socket(server, "/drive") as late:
        said = [late.recv(timeout=PATIENCE_S) for _ in range(2)]
    assert b"a jpeg" in said


def test_the_larger_picture_is_sent_to_pages_that_show_the_camera_and_to_no_others(server: GuardedServer) -> None:
    def pictures(page: Connection) -> Iterator[bytes]:
        return (said for said in iter(lambda: page.recv(timeout=PATIENCE_S), None) if isinstance(said, bytes))

    with open_socket(server, "/drive") as showing, open_socket(server, "/drive") as folded:
        for page, shows in ((showing, True), (folded, False)):
            page.send(json.dumps({"type": "view", "scene": False, "camera": shows}))
        until(lambda: server.shown.camera)
        server.tell(Newest.LARGER, b"\0larger")
        assert b"\0larger" in pictures(showing)
        server.tell(Newest.PICTURE, b"the last")
        assert b"\0larger" not in list(iter(pictures(folded).__next__, b"the last"))
        folded.send(json.dumps({"type": "view", "scene": False, "camera": True}))
        assert next(pictures(folded)) == b"\0larger"
    until(lambda: not server.shown.camera)


def test_no_part_of_the_page_s_script_replaces_a_function_of_another_part() -> None:
    """All parts share one scope, in which the last function of a name silently wins."""
    script = "\n".join((STATIC / name).read_text(encoding="utf-8") for name in SCRIPTS)
    names = re.findall(r"^(?:async )?function\*? (\w+)", script, re.MULTILINE)
    assert len(names) > 100
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_a_page_of_another_viser_is_refused_rather_than_served_unmended() -> None:
    with pytest.raises(RuntimeError, match="another page"):
        mended("<html><body>a viser to come</body></html>")


@pytest.mark.parametrize("broken", ["half a pair \ud800", b"bytes \xe4".decode("utf-8", "surrogateescape"), object()])
def test_what_cannot_be_sent_does_not_end_the_panels_of_any_page(server: GuardedServer, broken: Any) -> None:
    element = server.gui.add_html("at first")
    element.content = broken
    sound = server.gui.add_html("a sound panel")
    try:
        for _ in range(2):
            with open_socket(server, "/") as panels:
                panels.send(msgspec.msgpack.encode(CAMERA))
                received = b""
                while b"a sound panel" not in received:
                    received = unpacked(panels.recv(timeout=PATIENCE_S))
    finally:
        element.remove()
        sound.remove()


def unpacked(message: str | bytes) -> bytes:
    """Return the MessagePack of a message of viser: two lengths, then the packed text."""
    assert isinstance(message, bytes)
    return zstandard.ZstdDecompressor().decompress(message[16 : 16 + int.from_bytes(message[8:16], "little")])
