"""Who has shown the token of this start, in a request or as the first thing on a socket.

The token stands in the fragment of the printed link, which no browser sends anywhere; the page's script reads it there.
It is shown in a header by what the script fetches, and in the first message of each socket. Pictures in a panel can
send neither, so their addresses carry a key that opens files and nothing else; it reaches a page over its socket.
No cookie is set: cookies know no port, so a browser would send one to every server on this machine.
"""

import asyncio
import hmac
import logging
import secrets
from typing import Annotated
from urllib.parse import parse_qs, urlsplit

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request

from ltvn_viz.server.limited_log import LimitedLog

logger = logging.getLogger(__name__)

MAX_PROOF_BYTES = 4096
"""A socket takes no longer message before the token was shown."""
PROOF_WITHIN_S = 30.0
"""A page that draws without a graphics card may be busy for long before it says its first word."""
REFUSED_CODE = 4401
"""Closes a socket on which the token was not shown; `socket_worker.js` and `page.js` know it."""
REFUSED_REASON = "token refused"
_MAX_TOKEN = 200
_BEARER = "Bearer "


class _Shown(msgspec.Struct, frozen=True, tag="proof", tag_field="type", forbid_unknown_fields=True):
    token: Annotated[str, msgspec.Meta(max_length=_MAX_TOKEN)]


_FROM_JSON = msgspec.json.Decoder(_Shown)
_FROM_MSGPACK = msgspec.msgpack.Decoder(_Shown)


class Proof:
    """Knows the token, and the key of files, of one start."""

    def __init__(self, token: str, *, within_s: float = PROOF_WITHIN_S) -> None:
        """Wait so many seconds for the token on a socket."""
        self._token, self._within_s = token, within_s
        self._file_key = secrets.token_urlsafe(24)
        self._log = LimitedLog(logger)

    def file_address(self, address: str) -> str:
        """Return the address of a file as a picture in a panel may have it."""
        return f"{address}?key={self._file_key}"

    def is_in(self, request: Request) -> bool:
        """Tell whether a request for a file carries the token in its header, or the key of files in its address."""
        given = [value.removeprefix(_BEARER) for value in request.headers.get_all("Authorization")]
        if len(given) == 1 and _is_equal(given[0], self._token):
            return True
        key = parse_qs(urlsplit(request.path).query).get("key", [""])[0]
        return _is_equal(key, self._file_key)

    async def is_first_on(self, connection: ServerConnection) -> bool:
        """Wait for a socket's first message, and close the socket unless it is the token."""
        try:
            async with asyncio.timeout(self._within_s):
                shown = _read(await connection.recv())
        except ConnectionClosed:
            return False
        except TimeoutError:
            shown = None
        if shown is not None and _is_equal(shown.token, self._token):
            return True
        self._log.log(logging.INFO, "closed a socket on which the token of this start was not shown")
        await connection.close(REFUSED_CODE, REFUSED_REASON)
        return False


def _read(message: bytes | str) -> _Shown | None:
    try:
        return _FROM_JSON.decode(message) if isinstance(message, str) else _FROM_MSGPACK.decode(message)
    except (msgspec.DecodeError, RecursionError, ValueError):
        return None


def _is_equal(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), secret.encode())
