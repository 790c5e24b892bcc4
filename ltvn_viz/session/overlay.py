"""What a tool draws over the map, as data. Owns no drawing; `layers.why` does."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId, Pose


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line between two places on the floor."""

    start: tuple[float, float]
    """x, y in metres."""
    end: tuple[float, float]
    colour: Rgb8


@dataclass(frozen=True, slots=True)
class Label:
    """A few words at a place."""

    at: tuple[float, float]
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Overlay:
    """Everything that one tool draws; the same object as long as nothing changed."""

    strokes: tuple[Stroke, ...] = ()
    nodes: dict[NodeId, Rgb8] = field(default_factory=dict)
    """Nodes in another colour."""
    ghosts: tuple[tuple[float, float, float], ...] = ()
    """Poses x, y, yaw at which a see-through robot stands."""
    labels: tuple[Label, ...] = ()
    is_of_likeness: bool = False
    """Nodes are coloured by how alike they look."""


EMPTY_OVERLAY = Overlay()


def stroke(start: Pose | NDArray[np.float64], end: Pose | NDArray[np.float64], colour: Rgb8) -> Stroke:
    """Return a line between two poses or points (>=2,)."""
    return Stroke((float(start[0]), float(start[1])), (float(end[0]), float(end[1])), colour)
