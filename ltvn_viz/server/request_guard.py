"""Where a request comes from: Host and Origin of every request and every socket.

A server on 127.0.0.1 is still reachable by each web page that is open in the user's browser. So a request passes only
when it names this machine as its host (against DNS rebinding), and comes from this page or from nowhere (against other
sites, other ports included). Whether it has shown the token is `proof`'s to say. Pure functions of a request.
"""

import ipaddress
from http import HTTPStatus
from urllib.parse import urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ltvn_viz.server.responses import refuse


def refusal(request: Request) -> Response | None:
    """Return None for a request that comes from this machine's own page or from nowhere, else the answer."""
    headers = request.headers
    if not _names_this_machine(headers):
        return refuse(HTTPStatus.FORBIDDEN, "This server answers to localhost and 127.0.0.1 only.")
    if not _comes_from_this_page(headers):
        return refuse(HTTPStatus.FORBIDDEN, "This request comes from another site.")
    return None


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
