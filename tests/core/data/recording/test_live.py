"""A recording that is watched while it is written: the file is the same, and the port belongs to nobody else."""

import http.client
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

import psutil
import pytest

from ltvn_core.data.recording.live_server import live_address, port_of
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrf2.file_check import check_file
from ltvn_core.data.recording.viewer_server import open_here, serve_viewer
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, RecordingError, ServerError
from ltvn_core.navigation.events import Note, StampedEvent
from ltvn_core.verbs.option_types import announce_stream
from tests.waiting import PATIENCE_S

ABOUT = {"scene": "flat", "config": {}, "fingerprint": "flat"}


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def answer(port: int, path: str, host: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    with closing(connection):
        connection.request("GET", path, headers={"Host": host})
        return connection.getresponse()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_what_is_streamed_is_a_whole_recording_too_and_the_next_one_takes_the_same_port(tmp_path: Path) -> None:
    port = free_port()
    for name in ("first.rrd", "second.rrd"):
        with RecordingWriter(tmp_path / name, **ABOUT, live_port=port) as writer:
            writer.write_event(StampedEvent(1, 0.1, Note(name)))
            listening = [c for c in psutil.Process().net_connections("inet") if c.status == psutil.CONN_LISTEN]
            assert {c.laddr.ip for c in listening if c.laddr.port == port} == {"127.0.0.1"}
        assert check_file(tmp_path / name).finished
        assert [stamped.event for stamped in Recording.open(tmp_path / name).events] == [Note(name)]


def test_nobody_watches_without_the_secret_or_under_another_name(tmp_path: Path) -> None:
    port = free_port()
    place = urlsplit(live_address(port)).path
    with RecordingWriter(tmp_path / "a.rrd", **ABOUT, live_port=port):
        for path, host, status in (
            ("/", f"127.0.0.1:{port}", 404),
            ("/proxy", f"127.0.0.1:{port}", 404),
            (f"/{'x' * 22}/live.rrd", f"127.0.0.1:{port}", 404),
            (place, f"rebound.example:{port}", 403),
            (place, "rebound.example", 403),
        ):
            assert answer(port, path, host).status == status


def test_who_watches_gets_what_is_written_and_at_the_end_the_whole_file(tmp_path: Path) -> None:
    port, path = free_port(), tmp_path / "a.rrd"
    with RecordingWriter(path, **ABOUT, live_port=port) as writer:
        watched = urlopen(live_address(port), timeout=PATIENCE_S)
        seen = watched.read(200)
        writer.write_event(StampedEvent(1, 0.1, Note("later")))
        while b"later" not in seen:
            seen += watched.read1(1 << 16)
    with watched:
        seen += watched.read()
    assert seen == path.read_bytes()


def test_no_proxy_hears_of_the_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with socket.socket() as proxy:
        proxy.bind(("127.0.0.1", 0))
        proxy.listen()
        proxy.setblocking(False)
        for name in ("http_proxy", "HTTP_PROXY", "all_proxy"):
            monkeypatch.setenv(name, f"http://127.0.0.1:{proxy.getsockname()[1]}")
        for name in ("no_proxy", "NO_PROXY"):
            monkeypatch.delenv(name, raising=False)
        with RecordingWriter(tmp_path / "a.rrd", **ABOUT, live_port=port), serve_viewer(live_address(port)) as viewer:
            passed_on = open_here(f"{viewer.url}recording.rrd", PATIENCE_S)
            assert passed_on.read(4) == b"RRF2"
        passed_on.close()
        with pytest.raises(BlockingIOError):
            proxy.accept()


def test_a_port_that_is_taken_is_said_before_a_file_is_made(tmp_path: Path, taken: int) -> None:
    with pytest.raises(ServerError, match=str(taken)):
        RecordingWriter(tmp_path / "a.rrd", **ABOUT, live_port=taken)
    assert not list(tmp_path.iterdir())


def test_an_address_is_read_as_it_was_written() -> None:
    assert port_of(live_address(9877)) == 9877
    assert port_of("rerun+http://elsewhere:9877/proxy") is None
    assert port_of(live_address(9877).replace("127.0.0.1", "elsewhere")) is None
    assert port_of("a.rrd") is None


@pytest.mark.parametrize("port", [0, -1, 65536])
def test_a_number_that_is_no_port_is_refused(port: int) -> None:
    with pytest.raises(OptionError, match="--stream"):
        announce_stream(port)


@pytest.mark.parametrize(
    "address",
    [
        "http://example.com/x.rrd",
        "https://example.com/x.rrd",
        "rerun+http://127.0.0.1:9876/proxy",
        "http://127.0.0.1:1/s",
    ],
)
def test_an_address_that_no_run_prints_is_not_taken_for_a_file(address: str) -> None:
    with pytest.raises(RecordingError, match="--stream") as refused, serve_viewer(address):
        pass
    assert address in str(refused.value)


def test_an_address_at_which_nothing_is_recorded_is_refused_before_a_page_is_offered() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free = probe.getsockname()[1]
    with pytest.raises(RecordingError, match="Nothing is being recorded"), serve_viewer(live_address(free)):
        pass
