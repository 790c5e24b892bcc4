"""An office is large, connected and drivable, and its rooms are equal on purpose."""

import hashlib
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.office import FURNISHINGS, generate_office, generate_office_plan
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.rooms import Room, RoomKind

SEED, AREA_M2 = 8500, 500.0
SHA256 = "a749bc5cdf057142da4cc6edd46a1747444a064f3d0d29a2a47f982325d06eb6"


@pytest.fixture(scope="module")
def office() -> Building:
    return generate_office(SEED, AREA_M2)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(400, 600))
def test_every_office_has_twenty_rooms_of_one_size_with_equal_doors(seed: int, area_m2: float) -> None:
    plan = generate_office_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    offices = [index for index, room in enumerate(plan.rooms) if room.kind is not RoomKind.HALL]
    doors = [door for door in plan.doorways if set(door.rooms) & set(offices)]

    assert plan.width * plan.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(plan.width * plan.depth)
    assert len(offices) == 20
    assert len({_size(plan.rooms[index]) for index in offices}) == 1
    assert Counter(index for door in doors for index in door.rooms if index in offices) == Counter(offices)
    assert {round(door.width_m, 3) for door in doors} == {0.95}


def test_a_robot_gets_from_any_free_place_to_any_other(office: Building) -> None:
    clearance = ClearanceMap(office.blocked, office.origin)
    assert np.count_nonzero(clearance.grid > PLANNING_CLEARANCE_M) < 1.01 * np.count_nonzero(clearance.navigable)
    places = clearance.origin + (np.argwhere(clearance.navigable)[:, ::-1] + 0.5) * clearance.resolution_m
    for room in office.plan.rooms:
        inside = ((places > (room.x0, room.y0)) & (places < (room.x1, room.y1))).all(1)
        assert inside.sum() * clearance.resolution_m**2 > 0.3 * room.area_m2


def test_rooms_repeat_their_furniture(office: Building) -> None:
    rooms = [room for room in office.plan.rooms if room.kind is not RoomKind.HALL]
    kinds = {tuple(kind for kind, _ in _furniture_of(office, room)) for room in rooms}
    assert len(kinds) == 1
    # Where a door is on the other side, a piece may find no place at first, and other draws follow.
    ways = Counter(_furniture_of(office, room) for room in rooms)
    assert len(ways) <= 2 * FURNISHINGS
    assert sum(rooms_alike for rooms_alike in ways.values() if rooms_alike > 1) >= 15


def test_an_office_is_the_same_on_every_machine(office: Building) -> None:
    """A change here means other offices: raise GENERATOR_VERSION."""
    shape = office.surfaces.vertices.astype("<f4"), office.surfaces.faces.astype("<i4"), office.blocked.astype(np.uint8)
    looks = office.surfaces.corner_uv.astype("<f4"), office.surfaces.face_texture.astype("<i4")
    arrays = (*shape, *looks, *office.surfaces.textures)
    assert hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest() == SHA256


def _size(room: Room) -> tuple[float, float]:
    return round(room.x1 - room.x0, 3), round(room.y1 - room.y0, 3)


def _furniture_of(office: Building, room: Room) -> tuple[tuple[str, float], ...]:
    """Return kinds and widths of what stands in a room."""
    inside = (p for p in office.parts.furniture if room.x0 < p.x < room.x1 and room.y0 < p.y < room.y1)
    return tuple(sorted((piece.name.rsplit("-", 1)[0], round(piece.width, 3)) for piece in inside))
