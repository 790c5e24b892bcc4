"""The floor plan of an office: twenty rooms of one size, with equal doors, along two corridors that two others join.

Hard to map on purpose: what tells its rooms apart is the way there. Makes no geometry. Coordinates are as in
`floor_plan`.

    +--+----+----+----+----+----+--+
    |  |    |    |    |    |    |  |
    |  +- --+- --+- --+- --+- --+  |
    |                              |
    |  +- --+- --+- --+- --+- --+  |
    |  |    |    |    |    |    |  |
    |  +----+----+----+----+----+  |
    |  |    |    |    |    |    |  |
    |  +- --+- --+- --+- --+- --+  |
    |                              |
    |  +- --+- --+- --+- --+- --+  |
    |  |    |    |    |    |    |  |
    +--+----+----+----+----+----+--+
"""

from itertools import product

from ltvn_core.simulation.apartments.floor_plan import GRID_STEP_M, FloorPlan, mirrored, snap
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind

ROOMS_IN_ROW = 5
ROWS = 4
_CORRIDORS = 2
_DOORWAY_M = 0.95
_OPENING_INSET_M = 0.15
"""Where two corridors meet, so much wall is left on each side."""


def generate_office_plan(rng: SeededRng, area_m2: float) -> FloorPlan:
    """Return the floor plan of an office with a given area (400 to 600 m2); its corridors come first."""
    corridor = rng.uniform_multiple(1.6, 1.9)
    deep = rng.uniform_multiple(3.6, 4.0)
    depth = snap(ROWS * deep + _CORRIDORS * corridor)
    wide = snap((area_m2 / depth - 2 * corridor) / ROOMS_IN_ROW)
    width = snap(ROOMS_IN_ROW * wide + 2 * corridor)
    door_at = rng.uniform_multiple(0.5, wide - 0.5 - _DOORWAY_M, GRID_STEP_M)
    lows = [0.0, snap(deep + corridor), snap(2 * deep + corridor), snap(3 * deep + 2 * corridor)]
    halls = _corridors(width, depth, corridor, (lows[0] + deep, lows[2] + deep))
    offices: list[Room] = []
    doorways = [_opening(halls, along, across) for along, across in product((0, 1), (2, 3))]
    for row, number in product(range(ROWS), range(ROOMS_IN_ROW)):
        x, y = snap(corridor + number * wide), lows[row]
        room = Room(kind=RoomKind.STUDY, x0=x, y0=y, x1=snap(x + wide), y1=snap(y + deep))
        wall = room.y1 if row % 2 == 0 else room.y0
        low = snap(x + door_at)
        ends = len(halls) + len(offices), row // 2
        doorways.append(Doorway(rooms=ends, axis=1, wall=wall, low=low, high=snap(low + _DOORWAY_M)))
        offices.append(room)
    plan = FloorPlan(width=width, depth=depth, rooms=(*halls, *offices), doorways=tuple(doorways))
    return mirrored(plan, rng)


def _corridors(width: float, depth: float, broad: float, lows: tuple[float, float]) -> tuple[Room, ...]:
    """Return the two corridors along x that begin at some y, and the two that join their ends."""
    along = [(broad, snap(low), snap(width - broad), snap(low + broad)) for low in lows]
    across = [(0.0, 0.0, broad, depth), (snap(width - broad), 0.0, width, depth)]
    return tuple(Room(RoomKind.HALL, *edges) for edges in (*along, *across))


def _opening(halls: tuple[Room, ...], along: int, across: int) -> Doorway:
    """Return the opening between a corridor along x and one that crosses its end."""
    corridor, other = halls[along], halls[across]
    return Doorway(
        rooms=(along, across),
        axis=0,
        wall=corridor.x0 if other.x0 < corridor.x0 else corridor.x1,
        low=snap(corridor.y0 + _OPENING_INSET_M),
        high=snap(corridor.y1 - _OPENING_INSET_M),
    )
