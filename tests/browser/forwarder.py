"""A forwarder between browser and app, as proxies are: it takes a prefix off each path, and may set the Host header."""

import asyncio
import queue
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress

PREFIX = "/lab"


@contextmanager
def forwarder(port: int, *, sets_host: bool = False) -> Iterator[str]:
    """Forward to a port of this machine; yield the address that the browser opens."""
    begun: queue.Queue[tuple[int, Callable[[], object]]] = queue.Queue()

    async def forward(from_page: asyncio.StreamReader, to_page: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError, asyncio.IncompleteReadError), closing(to_page):
            from_app, to_app = await asyncio.open_connection("127.0.0.1", port)
            to_app.write(_rewritten(await from_page.readuntil(b"\r\n\r\n"), port if sets_host else None))
            await asyncio.gather(_pump(from_page, to_app), _pump(from_app, to_page))

    async def serve() -> None:
        ended, loop = asyncio.Event(), asyncio.get_running_loop()
        server = await asyncio.start_server(forward, "127.0.0.1", 0)
        begun.put((server.sockets[0].getsockname()[1], lambda: loop.call_soon_threadsafe(ended.set)))
        await ended.wait()
        server.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    listening, end = begun.get()
    try:
        yield f"http://127.0.0.1:{listening}{PREFIX}/"
    finally:
        end()
        thread.join()


def _rewritten(head: bytes, port: int | None) -> bytes:
    """Return the head of a request without the prefix; a request outside it asks for what is not there."""
    method, path, rest = head.split(b" ", 2)
    inside = path.removeprefix(PREFIX.encode()) if path.startswith(f"{PREFIX}/".encode()) else b"/nothing"
    if port is not None:
        rest = re.sub(rb"(?im)^host:[^\r]*", b"Host: 127.0.0.1:%d" % port, rest)
    if b"\r\nupgrade:" not in rest.lower():
        rest = re.sub(rb"(?im)^connection:[^\r]*", b"Connection: close", rest)
    return b" ".join((method, inside, rest))


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    with suppress(ConnectionError), closing(sink):
        while part := await source.read(65536):
            sink.write(part)
            await sink.drain()
