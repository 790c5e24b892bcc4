"""Options of the verbs that draw a floor plan below a map."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class FloorPlanOptions:
    """Options for a floor plan and its alignment with the map."""

    floor_plan: Path | None = None
    """A floor plan of the building to lay under the map: the map.yaml of nav2. Maps of `ltvn export` are written in its
    frame."""
    align: tuple[str, ...] = ()
    """Where the plan lies: NODE=X,Y pairs, two and more, of a node and the point of the plan in metres where it is, as
    17=-1.5,2. By default the plan's frame is that of the map, which is odometry's."""
