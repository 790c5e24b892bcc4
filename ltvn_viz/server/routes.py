"""Files the page may ask for by number: `/thumb/17.jpg`.

An address is a known prefix, a whole number and an ending; a handler gets the number alone, so that no path of a URL
ever reaches the disk.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import TypeAlias

from websockets.http11 import Response

from ltvn_viz.server.responses import refuse, reply

RouteHandler: TypeAlias = Callable[[int], bytes | None]
"""Returns the bytes of the thing with that number, None if there is none. Is called in a worker thread."""

CONTENT_TYPES = {"jpg": "image/jpeg", "png": "image/png", "glb": "model/gltf-binary", "json": "application/json"}

_PREFIX = re.compile(r"/[a-z][a-z-]*/", re.ASCII)
_ADDRESS = re.compile(r"(?P<prefix>/[a-z][a-z-]*/)(?P<number>0|[1-9][0-9]{0,11})\.(?P<ending>[a-z]{3,4})", re.ASCII)


@dataclass(frozen=True, slots=True)
class RouteMatch:
    """A known address."""

    handler: RouteHandler
    number: int
    ending: str

    def answer(self) -> Response:
        """Ask the handler and wrap what it gives."""
        content = self.handler(self.number)
        if content is None:
            return not_found()
        return reply(HTTPStatus.OK, content, content_type=CONTENT_TYPES[self.ending])


class Routes:
    """The table of known addresses."""

    def __init__(self) -> None:
        self._handlers: dict[tuple[str, str], RouteHandler] = {}

    def add(self, prefix: str, handler: RouteHandler, *, ending: str = "jpg") -> None:
        """Serve `prefix<number>.ending`; prefix is like `/thumb/`, raises ValueError for another form."""
        if not _PREFIX.fullmatch(prefix) or ending not in CONTENT_TYPES:
            raise ValueError(f"{prefix!r} with {ending!r}: want a prefix like /thumb/ and one of {list(CONTENT_TYPES)}")
        self._handlers[prefix, ending] = handler

    def find(self, path: str) -> RouteMatch | None:
        """Return who answers for `path` (no query), None when nobody does."""
        if (found := _ADDRESS.fullmatch(path)) is None:
            return None
        handler = self._handlers.get((found["prefix"], found["ending"]))
        return handler and RouteMatch(handler, int(found["number"]), found["ending"])


def not_found() -> Response:
    """Return the answer for everything unknown; it repeats nothing of the address."""
    return refuse(HTTPStatus.NOT_FOUND, "There is nothing here.")
