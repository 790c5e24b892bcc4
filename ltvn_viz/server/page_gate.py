"""The filter of all messages that pages send on viser's socket.

viser trusts its pages: it applies every message and forwards it to all other pages. So each message passes this filter
first. It must be of a kind that our pages send, with fields of the right type and size (`page_messages`); its element
must exist and accept the value (`takes`); and the page must have the permission: always for its own view, and only with
the driver's seat for shared elements. A refused message is dropped, and the page gets the element's present value
again; a page that sends unreadable bytes loses its socket.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, assert_never

import viser
from viser import _messages
from websockets.frames import CloseCode

from ltvn_viz.server.drive_messages import MessageError
from ltvn_viz.server.limits import GuardedConnection, LimitedLog, Pace, PageBudget, TooManyMessagesError
from ltvn_viz.server.page_messages import (
    MAX_UPLOAD_BYTES,
    PART_BYTES,
    CommandTrigger,
    DrawnImage,
    ElementUpdate,
    UploadPart,
    UploadStart,
    ViewerCamera,
    ViserMessage,
    read_viser_message,
    takes,
)

logger = logging.getLogger(__name__)


class Verdict(StrEnum):
    """The result of filtering a message; the value is its name in the counts."""

    ADMITTED = "admitted"
    UNREADABLE = "unreadable"
    """The bytes are not a message."""
    MALFORMED = "malformed"
    """The message is of another kind than our pages send, or a field has the wrong type or size."""
    UNFIT = "unfit"
    """The message's element does not exist, or does not accept this value."""
    WITHOUT_RIGHT = "without right"
    """The page does not have the seat."""


@dataclass
class _Upload:
    """A running upload of a file."""

    start: UploadStart
    next_part: int = 0
    received: int = 0


class PageGate:
    """Filters the messages of all pages to one viser server."""

    def __init__(self, may_drive: Callable[[str | None], bool], pace: Pace | None = None) -> None:
        """Set the limits `pace` of each page; `may_drive` returns whether the page with a key has or gets the seat."""
        self.pace = pace or Pace()
        self.may_drive = may_drive
        self.counts: Counter[Verdict] = Counter()
        self.log = LimitedLog(logger)
        self._viser: viser.ViserServer | None = None

    def guard(self, server: viser.ViserServer) -> None:
        """Filter messages for this server from now on; until then, all messages are dropped."""
        self._viser = server

    def page(self, connection: GuardedConnection, key: str | None) -> "GuardedPage":
        """Return a page's connection for viser, with filtered messages."""
        return GuardedPage(self, connection, key)

    def key_of(self, viser_client: int) -> str | None:
        """Return the secret key of a page, given viser's number of the page."""
        live = {} if self._viser is None else self._viser._websock_server._live_connections
        page = live.get(viser_client)
        return page.key if isinstance(page, GuardedPage) else None

    def judge(self, page: "GuardedPage", raw: bytes | str) -> Verdict:
        """Return the verdict on a message of a page; if a new value is refused, send the present one to the page."""
        try:
            message = read_viser_message(raw)
            verdict = Verdict.MALFORMED if message is None else self._judge(page, message)
        except MessageError as error:
            verdict = Verdict.UNREADABLE
            self.log.log(logging.WARNING, "closed a page's socket: %s", error)
        self.counts[verdict] += 1
        return verdict

    def _judge(self, page: "GuardedPage", message: ViserMessage) -> Verdict:
        client = page.client(self._viser) if self._viser is not None else None
        match message:
            case ViewerCamera():
                return Verdict.ADMITTED
            case _ if self._viser is None or client is None:
                return Verdict.UNFIT  # Like viser, this accepts a page only after its first camera message.
            case ElementUpdate():
                return self._judge_update(self._viser, client, page, message)
            case UploadStart() | UploadPart():
                return self._judge_upload(self._viser, client, page, message)
            case CommandTrigger(uuid):
                if uuid in client.gui._command_handle_from_uuid:
                    return Verdict.ADMITTED  # A page's own entry needs no seat.
                command = self._viser.gui._command_handle_from_uuid.get(uuid)
                return self._shared(page, is_fit=command is not None and not command._impl.props.disabled)
            case DrawnImage():
                return _verdict(
                    bool(client._websock_connection._incoming_handlers.get(_messages.GetRenderResponseMessage))
                )
            case _:
                assert_never(message)

    def _judge_update(
        self, server: viser.ViserServer, client: viser.ClientHandle, page: "GuardedPage", message: ElementUpdate
    ) -> Verdict:
        own: Any = client.gui._gui_input_handle_from_uuid.get(message.uuid)
        element: Any = own or server.gui._gui_input_handle_from_uuid.get(message.uuid)
        if element is None:
            return Verdict.UNFIT
        is_fit = takes(element, message.updates.value)
        verdict = _verdict(is_fit) if own is not None else self._shared(page, is_fit=is_fit)
        if verdict is not Verdict.ADMITTED:
            # The page shows its own value already, so it must be reset.
            back = _messages.GuiUpdateMessage(message.uuid, {"value": element.value})
            client._websock_connection.queue_message(back)
        return verdict

    def _judge_upload(
        self,
        server: viser.ViserServer,
        client: viser.ClientHandle,
        page: "GuardedPage",
        message: UploadStart | UploadPart,
    ) -> Verdict:
        if isinstance(message, UploadPart):
            return self._shared(page, is_fit=page.take_part(message))
        element = server.gui._gui_input_handle_from_uuid.get(message.source_component_uuid)
        is_fit = isinstance(element, viser.GuiUploadButtonHandle) and element.visible and not element.disabled
        # viser's page sends all parts of one size, and the rest.
        parts = -(-message.size_bytes // PART_BYTES)
        is_fit = is_fit and message.size_bytes <= MAX_UPLOAD_BYTES and message.part_count == parts
        verdict = self._shared(page, is_fit=is_fit)
        if verdict is Verdict.ADMITTED:
            # A page sends one file at a time, so an unfinished upload is dropped.
            server.gui._drop_uploads_from_client(client._websock_connection.client_id)  # type: ignore[arg-type]
            # viser stores its response to each piece of a file for later pages, which do not need them.
            buffer = server._websock_server.get_message_buffer()
            buffer.remove_from_buffer(lambda each: isinstance(each, _messages.FileTransferPartAck))
            page.upload = _Upload(message)
        return verdict

    def _shared(self, page: "GuardedPage", *, is_fit: bool) -> Verdict:
        """Return the verdict on the use of an element that all pages share."""
        if not is_fit:
            return Verdict.UNFIT
        return Verdict.ADMITTED if self.may_drive(page.key) else Verdict.WITHOUT_RIGHT


class GuardedPage:
    """A page's connection with the interface that viser needs, and a running upload."""

    def __init__(self, gate: PageGate, connection: GuardedConnection, key: str | None) -> None:
        self.key = key
        self.subprotocol = connection.subprotocol
        self._gate = gate
        self._connection = connection
        self._budget = PageBudget(gate.pace)
        self.upload: _Upload | None = None

    async def recv(self) -> bytes | str:
        """Return the next admitted message."""
        while True:
            raw = await self._connection.recv()
            try:
                wait_s = self._budget.count(raw)
            except TooManyMessagesError as error:
                self._gate.log.log(logging.WARNING, "closed a page's socket: %s", error)
                await self._connection.hang_up(error.told)
                continue  # The next `recv` reports the closed connection to viser.
            if wait_s > 0:
                await asyncio.sleep(wait_s)
            verdict = self._gate.judge(self, raw)
            if verdict is Verdict.ADMITTED:
                return raw
            if verdict is Verdict.UNREADABLE:
                await self._connection.hang_up(MessageError.told)

    async def send(self, message: bytes) -> None:
        """Send a message to the page."""
        await self._connection.send(message)

    async def close(self, code: int = CloseCode.NORMAL_CLOSURE, reason: str = "") -> None:
        """Close the connection."""
        await self._connection.close(code, reason)

    def client(self, server: viser.ViserServer) -> viser.ClientHandle | None:
        """Return viser's handle of this page; None before its first camera message."""
        live = server._websock_server._live_connections
        number = next((each for each, connection in live.items() if connection is self), None)  # type: ignore[comparison-overlap]
        return None if number is None else server._connected_clients.get(number)

    def take_part(self, message: UploadPart) -> bool:
        """Count a part of the running upload; return whether it is the next one."""
        upload = self.upload
        if upload is None:
            return False
        start = upload.start
        if (message.transfer_uuid, message.source_component_uuid) != (start.transfer_uuid, start.source_component_uuid):
            return False
        upload.received += len(message.content)
        is_next = message.part_index == upload.next_part < start.part_count and upload.received <= start.size_bytes
        upload.next_part += 1
        if not is_next or upload.next_part == start.part_count:
            self.upload = None
        return is_next


def _verdict(is_fit: bool) -> Verdict:
    return Verdict.ADMITTED if is_fit else Verdict.UNFIT
