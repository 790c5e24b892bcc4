"""Which values an element of viser's panels takes."""

import math
from typing import Any

import viser
from viser import GuiInputHandle

from ltvn_viz.server.page_messages import Value


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
            return False  # No panel of ours has another kind; whoever adds one adds its range here.


def shared_elements(gui: viser.GuiApi) -> list[str]:
    """Return the names of the controls that all pages share, which viser's page gives to their elements as ids."""
    return list(gui._gui_input_handle_from_uuid)


def _is_between(value: object, least: float | None, most: float | None) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return False
    return (least is None or value >= least) and (most is None or value <= most) and abs(value) <= _LARGEST


_LARGEST = 1e9
