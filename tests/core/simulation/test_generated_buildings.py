"""Generated buildings are drivable, as large as asked, the same on every machine, and as their family should be."""

from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.hall import OPEN_ISLANDS, generate_hall, generate_hall_plan
from ltvn_core.simulation.apartments.office import generate_office, generate_office_plan
from ltvn_core.simulation.apartments.plain_building import generate_plain_building
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.shop import generate_shop, generate_shop_plan
from ltvn_core.simulation.apartments.wings import generate_wings, generate_wings_plan
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rooms import Doorway, FurniturePiece, Room, RoomKind
from tests.core.simulation.toured_building import digest, tour, unreachable_share


class Family(NamedTuple):
    """How a kind of building is made, and what one of it is."""

    generate: Callable[[int, float], Building]
    seed: int
    area_m2: float
    sha256: str
    """Of that building; a change here means other buildings: raise GENERATOR_VERSION."""
    areas_m2: tuple[float, float]
    """The smallest and the largest that are made."""


FAMILIES = {
    "hall": Family(
        generate_hall, 12503, 600.0, "1eea4386b1198a5525ac2b5c13574f1dcb5ee0d40f981c1de2833ec11e2602ff", (300, 650)
    ),
    "office": Family(
        generate_office, 8500, 500.0, "a749bc5cdf057142da4cc6edd46a1747444a064f3d0d29a2a47f982325d06eb6", (400, 450)
    ),
    "plain": Family(
        generate_plain_building,
        8203,
        200.0,
        "4aee06eab93cb9381f2225b52a8bb338172070de8e4b7f776cbe5c2f7b4c6a31",
        (150, 250),
    ),
    "shop": Family(
        generate_shop, 11503, 560.0, "3955a76f201848606b1d001b94adae7012b9d34af5fce3c2dbeec89bed7d07c0", (200, 800)
    ),
    "wings": Family(
        generate_wings, 13500, 620.0, "a4a5d9addb0514b6ba9c1108a01cd9374b7e7d314322a358bbe30bfe60c6209d", (600, 700)
    ),
}
each_family = pytest.mark.parametrize("name", FAMILIES)
SEEDS = st.integers(0, 2**31)
KINDS = (RoomKind.STUDY, RoomKind.MEETING)
"""Kinds of rooms in a building with wings that are copies of each other."""


@cache
def building(name: str) -> Building:
    """Return the building of a family that stands for it."""
    family = FAMILIES[name]
    return family.generate(family.seed, family.area_m2)


@each_family
def test_a_building_is_the_same_on_every_machine_and_as_large_as_asked(name: str) -> None:
    plan = building(name).plan
    assert digest(building(name)) == FAMILIES[name].sha256
    assert plan.width * plan.depth == pytest.approx(FAMILIES[name].area_m2, rel=0.02)


@each_family
@settings(max_examples=2)
@given(seed=SEEDS, share=st.floats(0, 1))
def test_a_robot_gets_everywhere_in_every_building(name: str, seed: int, share: float) -> None:
    smallest, largest = FAMILIES[name].areas_m2
    assert unreachable_share(FAMILIES[name].generate(seed, smallest + share * (largest - smallest))) < 0.01


@pytest.mark.parametrize(("name", "left_out"), [("hall", 0), ("shop", 0), ("wings", 2)])
def test_a_tour_goes_through_all_parts_and_touches_nothing(name: str, left_out: int) -> None:
    driven = tour(building(name))
    assert driven.collisions <= 1
    # A stop in a small room may be in its door, where the robot arrives from outside.
    assert sum(not driven.images_in(room) for room in building(name).plan.rooms) <= left_out


@settings(max_examples=20)
@given(seed=SEEDS, area_m2=st.floats(300, 650))
def test_every_hall_takes_most_of_the_floor_and_has_a_door_to_each_small_room(seed: int, area_m2: float) -> None:
    plan = generate_hall_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    hall, *small = plan.rooms
    assert plan.width * plan.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(plan.width * plan.depth)
    assert hall.area_m2 > 0.7 * area_m2
    assert 2 <= len(small) <= 4
    assert sorted(door.rooms for door in plan.doorways) == [(0, number + 1) for number in range(len(small))]
    assert all(0.9 <= door.width_m < 1.0 for door in plan.doorways)


def test_under_the_furniture_of_an_open_hall_there_is_floor_that_a_locobot_does_not_fit_on() -> None:
    hall = generate_hall(14500, 320.0, OPEN_ISLANDS)
    clearance = ClearanceMap(hall.blocked, hall.origin)
    low = [piece for piece in hall.parts.furniture if piece.name.startswith(("open-", "bar-"))]
    assert len(low) >= 6
    assert all(clearance.at(np.array([[piece.x, piece.y]]))[0] == 0 for piece in low)
    assert unreachable_share(hall) < 0.01


@settings(max_examples=20)
@given(seed=SEEDS, area_m2=st.floats(400, 600))
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


@settings(max_examples=20)
@given(seed=SEEDS, area_m2=st.floats(200, 800))
def test_the_parts_of_every_shop_cover_its_floor_and_are_open_to_each_other(seed: int, area_m2: float) -> None:
    plan = generate_shop_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    zones = [zone for hall in plan.walls.rooms for zone in plan.zones(hall)]
    assert plan.walls.width * plan.walls.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(zone.area_m2 for zone in zones) == pytest.approx(plan.walls.width * plan.walls.depth)
    assert len(plan.walls.rooms) == (1 if area_m2 <= 400 else 2)
    assert all(zone.shorter_side_m > 1.6 for zone in zones)


@settings(max_examples=20)
@given(seed=SEEDS, area_m2=st.floats(600, 1500))
def test_rooms_of_a_kind_have_one_size_and_equal_doors_in_every_building_with_wings(seed: int, area_m2: float) -> None:
    plan = generate_wings_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    assert plan.width * plan.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(plan.width * plan.depth)
    for kind in KINDS:
        rooms = [number for number, room in enumerate(plan.rooms) if room.kind is kind]
        assert len({_size(plan.rooms[number]) for number in rooms}) == 1
        doors = [door for door in plan.doorways if set(door.rooms) & set(rooms)]
        assert Counter(number for door in doors for number in door.rooms if number in rooms) == Counter(rooms)
        assert {round(door.width_m, 3) for door in doors} == {0.95}
    meeting = {number for number, room in enumerate(plan.rooms) if room.kind is RoomKind.MEETING}
    corridor_of = {max(door.rooms): min(door.rooms) for door in plan.doorways if set(door.rooms) & meeting}
    opposite = Counter((corridor_of[number], plan.rooms[number].x0) for number in meeting)
    assert len(opposite) >= 2
    assert set(opposite.values()) == {2}


@pytest.mark.parametrize("kind", KINDS)
def test_all_rooms_of_a_kind_hold_the_same_furniture_and_few_have_posters(kind: RoomKind) -> None:
    wings = building("wings")
    arrangements = {_arrangement(wings, number) for number, room in enumerate(wings.plan.rooms) if room.kind is kind}
    assert len(arrangements) == 1
    assert len(arrangements.pop()) >= 3
    offices = sum(room.kind is not RoomKind.HALL for room in wings.plan.rooms)
    assert 1 < len(wings.parts.paintings) < offices / 2 + 8


def _size(room: Room) -> tuple[float, float]:
    return round(room.x1 - room.x0, 3), round(room.y1 - room.y0, 3)


def _pieces_in(house: Building, room: Room) -> list[FurniturePiece]:
    return [p for p in house.parts.furniture if room.x0 < p.x < room.x1 and room.y0 < p.y < room.y1]


def _arrangement(wings: Building, number: int) -> tuple[tuple[object, ...], ...]:
    """Return for each piece in a room its kind, place, turn and textures, as seen from the door."""
    room = wings.plan.rooms[number]
    door = next(door for door in wings.plan.doorways if number in door.rooms)
    return tuple(sorted(_from_door(wings, piece, door, room) for piece in _pieces_in(wings, room)))


def _from_door(wings: Building, piece: FurniturePiece, door: Doorway, room: Room) -> tuple[object, ...]:
    x, y = door.middle
    half_turn = -1 if door.wall == room.y1 else 1
    numbers = (piece.x - x) * half_turn, (piece.y - y) * half_turn, *(half_turn * part for part in piece.turn)
    textures = tuple(wings.surfaces.face_texture[piece.first_face : piece.end_face].tolist())
    return piece.name.rpartition("-")[0], *(round(number, 3) + 0.0 for number in numbers), textures
