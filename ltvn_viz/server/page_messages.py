"""What a page may say on viser's own socket, and the strict reading of it.

Owns types, sizes and plain ranges of every field. Whether the thing that a message is about exists, takes this value,
and is for this page to use, is `page_gate`'s to say.
"""

import math
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
import viser
from msgspec import Meta
from viser import GuiInputHandle

from ltvn_viz.server.drive_messages import MessageError

MAX_TEXT = 10_000
"""Characters of anything typed."""
MAX_NAME = 300
"""Characters of a name."""
MAX_UPLOAD_BYTES = 32 * 2**20
PART_BYTES = 512 * 1024
"""Size of the pieces in which viser's page sends a file, in bytes."""
MAX_IMAGE_BYTES = 16 * 2**20
"""Of what a page draws when the app asks it to."""
MAX_MESSAGE_BYTES = MAX_IMAGE_BYTES + 1024

_Number: TypeAlias = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Vector: TypeAlias = tuple[_Number, _Number, _Number]
_Name: TypeAlias = Annotated[str, Meta(max_length=MAX_NAME)]
_Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**31)]
_Modifier: TypeAlias = Literal[
    "cmd/ctrl", "alt", "shift", "cmd/ctrl+alt", "cmd/ctrl+shift", "alt+shift", "cmd/ctrl+alt+shift"
]
Value: TypeAlias = (
    bool | int | float | Annotated[str, Meta(max_length=MAX_TEXT)] | Annotated[list[int | float], Meta(max_length=16)]
)
"""What an element can be set to; the numbers are not limited yet."""


class ViewerCamera(
    msgspec.Struct, frozen=True, tag="ViewerCameraMessage", tag_field="type", forbid_unknown_fields=True
):
    """From where the person looks; metres and radians."""

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
    """A page changes nothing of an element but its value."""

    value: Value


class ElementUpdate(msgspec.Struct, frozen=True, tag="GuiUpdateMessage", tag_field="type", forbid_unknown_fields=True):
    """A control was used."""

    uuid: _Name
    updates: NewValue


class NodeClick(msgspec.Struct, frozen=True, tag="SceneNodeClickMessage", tag_field="type", forbid_unknown_fields=True):
    """Something in the scene was clicked."""

    name: _Name
    ray_origin: _Vector
    ray_direction: _Vector
    screen_pos: tuple[_Number, _Number]
    instance_index: _Count | None
    modifier: _Modifier | None
    owner: _Name = ""


class UploadStart(
    msgspec.Struct, frozen=True, tag="FileTransferStartUpload", tag_field="type", forbid_unknown_fields=True
):
    """A file is about to come."""

    source_component_uuid: _Name
    transfer_uuid: _Name
    filename: _Name
    mime_type: _Name
    part_count: _Count
    size_bytes: _Count


class UploadPart(msgspec.Struct, frozen=True, tag="FileTransferPart", tag_field="type", forbid_unknown_fields=True):
    """A piece of a file."""

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
    """What the app asked the page to draw."""

    payload: Annotated[bytes, Meta(max_length=MAX_IMAGE_BYTES)]
    render_uuid: _Name


ViserMessage: TypeAlias = (
    ViewerCamera | ElementUpdate | NodeClick | UploadStart | UploadPart | CommandTrigger | DrawnImage
)
"""Everything that a page of ours has reason to say."""

_DECODER = msgspec.msgpack.Decoder(ViserMessage)


def read_viser_message(raw: bytes | str) -> ViserMessage | None:
    """Read one message of a page, None where a field is not what it must be. Raises MessageError for what is none."""
    if isinstance(raw, str):
        raise MessageError("text where MessagePack is spoken")
    try:
        return _DECODER.decode(raw)
    except msgspec.ValidationError:
        return None
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise MessageError(f"no MessagePack: {error}") from error


def takes(handle: GuiInputHandle[Any], value: Value) -> bool:
    """Tell whether a page may set an element that is there to `value`; hidden and disabled ones take nothing."""
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
            return False  # Our panels have no other kind; a new kind adds its range here.


def shared_elements(gui: viser.GuiApi) -> list[str]:
    """Return the names of the controls that all pages share, which viser's page gives to their elements as ids."""
    return list(gui._gui_input_handle_from_uuid)


def _is_between(value: object, least: float | None, most: float | None) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return False
    return (least is None or value >= least) and (most is None or value <= most) and abs(value) <= _LARGEST


_LARGEST = 1e9
