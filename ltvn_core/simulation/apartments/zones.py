"""Divides large halls into zones that count as rooms, although no walls separate them.

A tour of all rooms, or a goal drawn in each room, then covers the whole hall and not only one or two places in it.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, combinations

from ltvn_core.simulation.apartments.floor_plan import FloorPlan, common_wall
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind


def in_zones(plan: FloorPlan, zones: Sequence[Sequence[Room]]) -> FloorPlan:
    """Return a plan whose rooms are zones; two adjacent zones of a room are connected along their whole common edge.

    Args:
        plan: The plan with the rooms that walls divide.
        zones: The zones that tile each room, or the room itself. Two adjacent aisles are not connected, because shelves
            stand between them.
    """
    firsts = [0, *accumulate(len(parts) for parts in zones)]
    doorways = [
        replace(door, rooms=(_zone_at(door, 0, zones, firsts), _zone_at(door, 1, zones, firsts)))
        for door in plan.doorways
    ]
    rooms = tuple(zone for parts in zones for zone in parts)
    for first, parts in zip(firsts, zones, strict=False):
        for a, b in combinations(range(first, first + len(parts)), 2):
            passage = common_wall(rooms, a, b)
            if passage is not None and {rooms[a].kind, rooms[b].kind} != {RoomKind.AISLE}:
                doorways.append(passage)
    return replace(plan, rooms=rooms, doorways=tuple(doorways))


def _zone_at(door: Doorway, end: int, zones: Sequence[Sequence[Room]], firsts: Sequence[int]) -> int:
    """Return the number of the zone that a doorway leads to in one of its two rooms."""
    x, y = door.middle
    room = door.rooms[end]
    nearest = min(
        range(len(zones[room])),
        key=lambda k: _outside_m(zones[room][k], x, y),
    )
    return firsts[room] + nearest


def _outside_m(zone: Room, x: float, y: float) -> float:
    """Return the distance in metres of a point outside a zone, as the maximum over both axes; at most 0 inside."""
    return max(zone.x0 - x, x - zone.x1, zone.y0 - y, y - zone.y1)
