"""HTTP requests: checks of origin and token, the table of routes, and responses with security headers.

Every web page that is open in the user's browser can reach a server on 127.0.0.1. So a request is accepted only if its
host is this machine (against DNS rebinding), and its origin is this page or empty (against other sites, including other
ports). Each response has headers that keep other sites out. The address of a file consists of a known prefix, an
integer and an ending; a handler gets only the integer, so no path of a URL is ever used on the disk.

Each start of the app has a token. It is in the fragment of the printed link, which browsers do not send; the page's
script reads it there. The script sends it in a header of each fetch, and in the first message of each socket. Pictures
in a panel can send neither, so their addresses contain a key that is valid only for pictures; a page gets it over its
socket. No cookie is set, because browsers send a cookie to all ports of this machine.
"""

import asyncio
import hmac
import ipaddress
import logging
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Annotated, TypeAlias
from urllib.parse import parse_qs, urlsplit

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from ltvn_viz.server.limits import LimitedLog

SECURITY_HEADERS = (
    ("Cache-Control", "no-store"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
)

NOTHING_ALLOWED = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
"""Content policy of all responses except the page itself."""

TEXT = "text/plain; charset=utf-8"
LINK_PARAMETERS = ("replay", "at", "node", "edge", "tool")
"""Parameters of links, which the page's script reads and removes from its address."""
HTML = "text/html; charset=utf-8"

OTHER_HOST = (
    "This server answers to localhost and 127.0.0.1 only, so that no other site can reach it. To open its page on "
    "another machine, run there: ssh -L PORT:127.0.0.1:PORT THIS_MACHINE, with the port of the link in the app's "
    "terminal; then open that link."
)
OTHER_SITE = "This request comes from another site, and only the page of this server may ask. Open the app's own link."


def reply(
    status: HTTPStatus,
    body: str | bytes,
    *,
    content_type: str = TEXT,
    policy: str = NOTHING_ALLOWED,
) -> Response:
    """Return a response with the security headers."""
    content = body.encode() if isinstance(body, str) else body
    headers = Headers(
        [
            ("Content-Type", content_type),
            ("Content-Length", str(len(content))),
            ("Content-Security-Policy", policy),
            *SECURITY_HEADERS,
        ]
    )
    return Response(status.value, status.phrase, headers, content)


def refuse(status: HTTPStatus, text: str) -> Response:
    """Return a refusal with a text for the person."""
    return reply(status, text + "\n")


def refusal(request: Request) -> Response | None:
    """Return the refusal of a request from another machine or site; None for a request to accept."""
    headers = request.headers
    if not _names_this_machine(headers):
        return refuse(HTTPStatus.FORBIDDEN, OTHER_HOST)
    if not _comes_from_this_page(headers):
        return refuse(HTTPStatus.FORBIDDEN, OTHER_SITE)
    return None


def is_websocket(headers: Headers) -> bool:
    """Tell whether a request asks for an upgrade to a websocket."""
    return any("websocket" in value.lower() for value in headers.get_all("Upgrade"))


def is_loopback(host: str) -> bool:
    """Tell whether `host` is a loopback address of this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _names_this_machine(headers: Headers) -> bool:
    hosts = headers.get_all("Host")
    return len(hosts) == 1 and is_loopback(_hostname(hosts[0]))


def _hostname(netloc: str) -> str:
    try:
        parts = urlsplit("//" + netloc)
        is_plain = parts.netloc == netloc and parts.username is None and "\\" not in netloc
        return (parts.hostname or "") if is_plain and parts.port != 0 else ""
    except ValueError:
        return ""


def _comes_from_this_page(headers: Headers) -> bool:
    origins = headers.get_all("Origin")
    if origins or is_websocket(headers):
        return len(origins) == 1 and _is_same_origin(origins[0], headers["Host"])
    if headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin"):
        return True
    # Links on other pages may open this page, but other pages may not fetch anything.
    return (headers.get("Sec-Fetch-Mode"), headers.get("Sec-Fetch-Dest")) == ("navigate", "document")


def _is_same_origin(origin: str, host: str) -> bool:
    # The origin has https behind a reverse proxy that terminates TLS and keeps the Host header.
    return origin in (f"http://{host}", f"https://{host}")


RouteHandler: TypeAlias = Callable[[int], bytes | None]
"""Returns the bytes of the file with a number; None if there is none. Called in a worker thread."""

CONTENT_TYPES = {
    "jpg": "image/jpeg",
    "png": "image/png",
    "glb": "model/gltf-binary",
    "json": "application/json",
    "bin": "application/octet-stream",
}
_PICTURES = ("image/jpeg", "image/png")
"""Content types for which the key in the address is valid."""

_PREFIX = re.compile(r"/[a-z][a-z-]*/", re.ASCII)
_ADDRESS = re.compile(r"(?P<prefix>/[a-z][a-z-]*/)(?P<number>0|[1-9][0-9]{0,11})\.(?P<ending>[a-z]{3,4})", re.ASCII)


@dataclass(frozen=True, slots=True)
class RouteMatch:
    """The handler and the number of a known address."""

    handler: RouteHandler
    number: int
    ending: str

    @property
    def is_picture(self) -> bool:
        """Whether this is a picture, which the key in its address makes available."""
        return CONTENT_TYPES[self.ending] in _PICTURES

    def answer(self) -> Response:
        """Call the handler and return its result as a response."""
        content = self.handler(self.number)
        if content is None:
            return not_found()
        return reply(HTTPStatus.OK, content, content_type=CONTENT_TYPES[self.ending])


class Routes:
    """The table of known addresses."""

    def __init__(self) -> None:
        self._handlers: dict[tuple[str, str], RouteHandler] = {}

    def add(self, prefix: str, handler: RouteHandler, *, ending: str = "jpg") -> None:
        """Serve `prefix<number>.ending`; `prefix` is like `/thumb/`. Raises ValueError for an invalid argument."""
        if not _PREFIX.fullmatch(prefix) or ending not in CONTENT_TYPES:
            raise ValueError(f"{prefix!r} with {ending!r}: want a prefix like /thumb/ and one of {list(CONTENT_TYPES)}")
        self._handlers[prefix, ending] = handler

    def find(self, path: str) -> RouteMatch | None:
        """Return the route of `path`, which has no query; None if there is none."""
        if (found := _ADDRESS.fullmatch(path)) is None:
            return None
        handler = self._handlers.get((found["prefix"], found["ending"]))
        return handler and RouteMatch(handler, int(found["number"]), found["ending"])


def not_found() -> Response:
    """Return the response for an unknown address; the response does not contain the address."""
    return refuse(HTTPStatus.NOT_FOUND, "There is nothing here.")


logger = logging.getLogger(__name__)

MAX_PROOF_BYTES = 4096
"""Maximum size of a message on a socket before its token was accepted, in bytes."""
PROOF_WITHIN_S = 30.0
"""Time limit for the token on a socket, in seconds; a page without a graphics card may be busy for long."""
REFUSED_CODE = 4401
"""Code for closing a socket without a valid token; `socket_worker.js` and `page.js` check it."""
REFUSED_REASON = "token refused"
_MAX_TOKEN = 200
_BEARER = "Bearer "


class _Shown(msgspec.Struct, frozen=True, tag="proof", tag_field="type", forbid_unknown_fields=True):
    token: Annotated[str, msgspec.Meta(max_length=_MAX_TOKEN)]


_FROM_JSON = msgspec.json.Decoder(_Shown)
_FROM_MSGPACK = msgspec.msgpack.Decoder(_Shown)


class Proof:
    """Checks the token, and the key of pictures, of one start of the app."""

    def __init__(self, token: str, *, within_s: float = PROOF_WITHIN_S) -> None:
        """Set the token, and the time limit in seconds for the token on a socket."""
        self._token = token
        self._within_s = within_s
        self._file_key = secrets.token_urlsafe(24)
        self._log = LimitedLog(logger)

    def file_address(self, address: str) -> str:
        """Return the address of a file with the key that a picture in a panel needs."""
        # Relative to the page, which may stand below a path.
        return f"{address.removeprefix('/')}?key={self._file_key}"

    def is_in(self, request: Request, *, is_for_picture: bool) -> bool:
        """Tell whether a request has the token in its header or, for a picture, the picture key in its address."""
        given = [value.removeprefix(_BEARER) for value in request.headers.get_all("Authorization")]
        if len(given) == 1 and _is_equal(given[0], self._token):
            return True
        if not is_for_picture:
            return False
        key = parse_qs(urlsplit(request.path).query).get("key", [""])[0]
        return _is_equal(key, self._file_key)

    async def is_first_on(self, connection: ServerConnection) -> bool:
        """Wait for a socket's first message, and close the socket unless it is the token."""
        try:
            async with asyncio.timeout(self._within_s):
                said = await connection.recv()
            shown = _FROM_JSON.decode(said) if isinstance(said, str) else _FROM_MSGPACK.decode(said)
        except ConnectionClosed:
            return False
        except (TimeoutError, msgspec.DecodeError, RecursionError, ValueError):
            shown = None
        if shown is not None and _is_equal(shown.token, self._token):
            return True
        self._log.log(logging.INFO, "closed a socket that did not send the token of this start")
        await connection.close(REFUSED_CODE, REFUSED_REASON)
        return False


def _is_equal(given: str, secret: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), secret.encode())
