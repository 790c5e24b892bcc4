"""Who may come in: token, Host and Origin of every request and every socket.

A server on 127.0.0.1 is still reachable by each web page that is open in the user's browser. So a request passes only
when it names this machine as its host (against DNS rebinding), comes from this page or from nowhere (against other
sites, other ports included), and carries the token. Pure functions of a request; owns no connection.
"""

import hmac
import ipaddress
from html import escape
from http import HTTPStatus
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ltvn_viz.server.responses import HTML, refuse, reply

ASK_FOR_TOKEN = "Open the address that was printed in the terminal; it carries the key (?token=...)."
CLEAN_PAGE = '<!doctype html><meta http-equiv="refresh" content="0; url={0}"><a href="{0}">Open the page</a>'


class RequestGuard:
    """Judge requests by one token."""

    def __init__(self, token: str, cookie: str) -> None:
        self._token = token
        self._cookie = cookie

    def refusal(self, request: Request) -> Response | None:
        """Return None for a request that may pass, else the answer: a refusal, or the cookie for a right token."""
        headers = request.headers
        if not _names_this_machine(headers):
            return refuse(HTTPStatus.FORBIDDEN, "This server answers to localhost and 127.0.0.1 only.")
        if not _comes_from_this_page(headers):
            return refuse(HTTPStatus.FORBIDDEN, "This request comes from another site.")
        if self._is_token(_cookie_value(headers, self._cookie)):
            return None
        given = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        if is_websocket(headers) or not self._is_token(given):
            return refuse(HTTPStatus.UNAUTHORIZED, ASK_FOR_TOKEN)
        return self._welcome(headers, _without_token(request.path))

    def _welcome(self, headers: Headers, address: str) -> Response:
        """Move the token from the URL, where it would be seen and kept, into a cookie that scripts cannot read."""
        cookie = ("Set-Cookie", f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/")
        # After a link on another site, a redirect would not carry the strict cookie; a refresh by our own page does.
        if headers.get("Sec-Fetch-Site", "none") in ("none", "same-origin"):
            return reply(HTTPStatus.SEE_OTHER, "", extra=(("Location", address), cookie))
        return reply(HTTPStatus.OK, CLEAN_PAGE.format(escape(address)), content_type=HTML, extra=(cookie,))

    def _is_token(self, value: str) -> bool:
        return hmac.compare_digest(value.encode("utf-8", "surrogateescape"), self._token.encode())


def _without_token(path: str) -> str:
    """Return the page's address with what else the query says, written anew, so that nothing strange gets through."""
    rest = urlencode([(name, value) for name, value in parse_qsl(urlsplit(path).query) if name != "token"])
    return f"/?{rest}" if rest else "/"


def is_websocket(headers: Headers) -> bool:
    """Tell whether a request wants to become a websocket."""
    return any("websocket" in value.lower() for value in headers.get_all("Upgrade"))


def is_loopback(host: str) -> bool:
    """Tell whether `host` is this machine and reachable from nowhere else."""
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
    # A link on another page may open this page, but nothing else may be fetched from there.
    return (headers.get("Sec-Fetch-Mode"), headers.get("Sec-Fetch-Dest")) == ("navigate", "document")


def _is_same_origin(origin: str, host: str) -> bool:
    # https stands before a reverse proxy that ends TLS and keeps the Host.
    return origin in (f"http://{host}", f"https://{host}")


def _cookie_value(headers: Headers, name: str) -> str:
    # Read by hand: the standard library's parser gives up at the first foreign cookie that it does not like.
    for header in headers.get_all("Cookie"):
        for pair in header.split(";"):
            key, _, value = pair.strip().partition("=")
            if key == name:
                return value
    return ""
