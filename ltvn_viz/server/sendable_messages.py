"""The last check of what is sent to pages: no layer or panel can end the panels of all pages.

viser encodes the messages of all pages in one place. A message that cannot be encoded would end the socket of each
page, also of later ones, because viser keeps the messages for them.
"""

import logging
from typing import Any

import msgspec
from viser.infra import Message

from ltvn_core.structured_text import readable_value
from ltvn_viz.server.limits import LimitedLog

logger = logging.getLogger(__name__)

_LEFT_OUT = "LeftOutMessage"
"""A type that viser's page does not know, and therefore ignores."""
_as_viser_does = Message.as_serializable_dict
_log = LimitedLog(logger)


def make_messages_sendable() -> None:
    """Let viser send messages with any text, and leave out those that it cannot encode."""
    Message.as_serializable_dict = _sendable  # type: ignore[method-assign]


def _sendable(message: Message, binary_buffers: list[memoryview] | None = None) -> dict[str, Any]:
    before = 0 if binary_buffers is None else len(binary_buffers)
    try:
        fields = _as_viser_does(message, binary_buffers)
        try:
            msgspec.msgpack.encode(fields)
        except UnicodeEncodeError:
            fields = readable_value(fields)
            msgspec.msgpack.encode(fields)
    except Exception as error:  # Whatever a layer or panel has put into it.
        if binary_buffers is not None:
            del binary_buffers[before:]
        kind = type(message).__name__
        _log.log(logging.ERROR, "a %s cannot be sent to the pages: %s: %.200s", kind, type(error).__name__, error)
        return {"type": _LEFT_OUT}
    return fields
