"""The messages that a page may send on viser's own socket, and their strict parser.

Owns the type, size and range of each field. `page_gate` checks that a message's element exists, accepts the value and
may be used by the page.
"""

import math
from typing import Annotated, Any, TypeAlias

import msgspec
import viser
from msgspec import Meta
from viser import GuiInputHandle

from ltvn_viz.server.drive_messages import MessageError

MAX_TEXT = 10_000
"""Maximum number of characters of typed text."""
MAX_NAME = 300
"""Maximum number of characters of a name."""
MAX_UPLOAD_BYTES = 32 * 2**20
PART_BYTES = 512 * 1024
"""Size of the pieces in which viser's page sends a file, in bytes."""
MAX_IMAGE_BYTES = 16 * 2**20
"""Maximum size of an image that a page renders for the app, in bytes."""
MAX_MESSAGE_BYTES = MAX_IMAGE_BYTES + 1024

_Number: TypeAlias = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Vector: TypeAlias = tuple[_Number, _Number, _Number]
_Name: TypeAlias = Annotated[str, Meta(max_length=MAX_NAME)]
_Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**31)]
Value: TypeAlias = (
    bool | int | float | Annotated[str, Meta(max_length=MAX_TEXT)] | Annotated[list[int | float], Meta(max_length=16)]
)
"""Value of an element; the range of numbers is checked later."""


class ViewerCamera(
    msgspec.Struct, frozen=True, tag="ViewerCameraMessage", tag_field="type", forbid_unknown_fields=True
):
    """The person's view of the scene, in metres and radians."""

    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Vector
    fov: Annotated[float, Meta(gt=0, lt=3.2)]
    near: _Number
    far: _Number
    image_height: Annotated[int, Meta(ge=0, le=32768)]
    image_width: Annotated[int, Meta(ge=0, le=32768)]
    look_at: _Vector
    up_direction: _Vector


class NewValue(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """New value of an element, its only property that a page may change."""

    value: Value


class ElementUpdate(msgspec.Struct, frozen=True, tag="GuiUpdateMessage", tag_field="type", forbid_unknown_fields=True):
    """A control was used."""

    uuid: _Name
    updates: NewValue


class UploadStart(
    msgspec.Struct, frozen=True, tag="FileTransferStartUpload", tag_field="type", forbid_unknown_fields=True
):
    """The start of an upload."""

    source_component_uuid: _Name
    transfer_uuid: _Name
    filename: _Name
    mime_type: _Name
    part_count: _Count
    size_bytes: _Count


class UploadPart(msgspec.Struct, frozen=True, tag="FileTransferPart", tag_field="type", forbid_unknown_fields=True):
    """A part of an uploaded file."""

    source_component_uuid: _Name | None
    transfer_uuid: _Name
    part_index: _Count
    content: Annotated[bytes, Meta(max_length=PART_BYTES)]


class CommandTrigger(
    msgspec.Struct, frozen=True, tag="CommandTriggerMessage", tag_field="type", forbid_unknown_fields=True
):
    """A command of viser's palette was chosen, or its key pressed."""

    uuid: _Name


class DrawnImage(
    msgspec.Struct, frozen=True, tag="GetRenderResponseMessage", tag_field="type", forbid_unknown_fields=True
):
    """An image that the page rendered for the app."""

    payload: Annotated[bytes, Meta(max_length=MAX_IMAGE_BYTES)]
    render_uuid: _Name


ViserMessage: TypeAlias = ViewerCamera | ElementUpdate | UploadStart | UploadPart | CommandTrigger | DrawnImage
"""All messages that our pages send."""

_DECODER = msgspec.msgpack.Decoder(ViserMessage)


def read_viser_message(raw: bytes | str) -> ViserMessage | None:
    """Parse one message of a page; None if a field is invalid. Raises MessageError if it is not a message."""
    if isinstance(raw, str):
        raise MessageError("a text message where MessagePack is expected")
    try:
        return _DECODER.decode(raw)
    except msgspec.ValidationError:
        return None
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise MessageError(f"no MessagePack: {error}") from error


def takes(handle: GuiInputHandle[Any], value: Value) -> bool:
    """Tell whether a page may set an element to `value`; hidden and disabled elements accept no value."""
    if handle._impl.removed or not handle.visible or handle.disabled:
        return False
    match handle:
        case viser.GuiButtonHandle():
            return value is True
        case viser.GuiCheckboxHandle():
            return isinstance(value, bool)
        case viser.GuiTextHandle():
            return isinstance(value, str)
        case viser.GuiDropdownHandle() | viser.GuiButtonGroupHandle():
            return isinstance(value, str) and value in handle.options
        case viser.GuiNumberHandle() | viser.GuiSliderHandle():
            return _is_between(value, handle.min, handle.max)
        case viser.GuiMultiSliderHandle():
            return (
                isinstance(value, list)
                and len(value) == len(handle.value)
                and all(_is_between(each, handle.min, handle.max) for each in value)
            )
        case _:
            return False  # Our panels have no other kinds of elements; a new kind needs its own range here.


def shared_elements(gui: viser.GuiApi) -> list[str]:
    """Return the names of the controls that all pages share; viser's page uses them as ids of HTML elements."""
    return list(gui._gui_input_handle_from_uuid)


def _is_between(value: object, least: float | None, most: float | None) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return False
    return (least is None or value >= least) and (most is None or value <= most) and abs(value) <= _LARGEST


_LARGEST = 1e9
