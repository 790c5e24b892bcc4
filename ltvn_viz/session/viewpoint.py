"""From where a person looks at the scene, as nine numbers that a link can carry.

Owns the word of the address and what makes sense as a view. `static/links.js` asks the same of a link before it hands
the numbers to viser, whose page puts the camera there.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core.errors import OptionError

Point: TypeAlias = tuple[float, float, float]

FARTHEST_M = 10_000.0
_CLOSEST_M = 0.001
_NINE = re.compile(r"[-+0-9.e]+(,[-+0-9.e]+){8}", re.ASCII)
_REFUSAL = (
    "This link names a view that makes no sense, so the view stays as it was; want camera= with nine numbers: where "
    "it is, what it looks at, and which way is up."
)


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera in the scene; metres."""

    position: Point
    look_at: Point
    up: Point

    @property
    def word(self) -> str:
        """The view as an address has it, to the millimetre."""
        return ",".join(f"{number:.3f}".rstrip("0").rstrip(".") for number in (*self.position, *self.look_at, *self.up))


def parse_viewpoint(word: str) -> Viewpoint:
    """Return the view that a word of an address names. Raises OptionError."""
    try:
        numbers = [float(part) for part in word.split(",")] if _NINE.fullmatch(word) else []
    except ValueError:
        numbers = []
    if not numbers or not all(abs(number) <= FARTHEST_M for number in numbers):
        raise OptionError(_REFUSAL)
    view = Viewpoint(_point(numbers[:3]), _point(numbers[3:6]), _point(numbers[6:]))
    if math.dist(view.position, view.look_at) < _CLOSEST_M or math.hypot(*view.up) < _CLOSEST_M:
        raise OptionError(_REFUSAL)
    return view


def latest_viewpoint(clients: Iterable[viser.ClientHandle]) -> Viewpoint | None:
    """Return the view of the page whose camera was moved last, None while there is no page."""
    cameras = [client.camera for client in clients]
    if not cameras:
        return None
    camera = max(cameras, key=lambda each: each.update_timestamp)
    return Viewpoint(_rounded(camera.position), _rounded(camera.look_at), _rounded(camera.up_direction))


def _point(numbers: Iterable[float]) -> Point:
    x, y, z = numbers
    return x, y, z


def _rounded(point: NDArray[np.float64]) -> Point:
    """Round to millimetres, so that a camera at rest is one view."""
    return _point(round(float(number), 3) + 0.0 for number in point)
