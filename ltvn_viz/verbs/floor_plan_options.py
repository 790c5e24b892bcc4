"""Options of the verbs that draw a floor plan below a map."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class FloorPlanOptions:
    """Options for a floor plan and its alignment with the map."""

    floor_plan: Path | None = None
    """Floor plan of the building to draw below the map: the map.yaml of nav2. `ltvn export` writes maps in its
    frame."""
    align: tuple[str, ...] = ()
    """Alignment of the plan: at least two pairs NODE=X,Y of a node and its position on the plan in metres, such as
    17=-1.5,2. By default, the plan has the same frame as the map, which is the odometry frame."""
