"""A building with wings repeats itself: its offices are copies of each other, and so are its meeting rooms."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.wings import generate_wings, generate_wings_plan
from ltvn_core.simulation.rooms import Doorway, FurniturePiece, Room, RoomKind
from tests.core.simulation.toured_building import digest, tour, unreachable_share

SEED, AREA_M2 = 13500, 620.0
SHA256 = "a4a5d9addb0514b6ba9c1108a01cd9374b7e7d314322a358bbe30bfe60c6209d"
KINDS = (RoomKind.STUDY, RoomKind.MEETING)


@pytest.fixture(scope="module")
def wings() -> Building:
    return generate_wings(SEED, AREA_M2)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(600, 1500))
def test_rooms_of_a_kind_have_one_size_and_equal_doors(seed: int, area_m2: float) -> None:
    plan = generate_wings_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    assert plan.width * plan.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(plan.width * plan.depth)
    for kind in KINDS:
        rooms = [number for number, room in enumerate(plan.rooms) if room.kind is kind]
        assert len({_size(plan.rooms[number]) for number in rooms}) == 1
        doors = [door for door in plan.doorways if set(door.rooms) & set(rooms)]
        assert Counter(number for door in doors for number in door.rooms if number in rooms) == Counter(rooms)
        assert {round(door.width_m, 3) for door in doors} == {0.95}


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(600, 1500))
def test_meeting_rooms_lie_opposite_each_other_across_a_corridor(seed: int, area_m2: float) -> None:
    plan = generate_wings_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    meeting = {number for number, room in enumerate(plan.rooms) if room.kind is RoomKind.MEETING}
    corridor_of = {max(door.rooms): min(door.rooms) for door in plan.doorways if set(door.rooms) & meeting}
    pairs = Counter((corridor_of[number], plan.rooms[number].x0) for number in meeting)
    assert len(pairs) >= 2
    assert set(pairs.values()) == {2}


@pytest.mark.parametrize("area_m2", [620.0, 1000.0])
def test_a_robot_gets_everywhere(area_m2: float) -> None:
    assert unreachable_share(generate_wings(7, area_m2)) < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_all_rooms_of_a_kind_hold_the_same_furniture_in_the_same_places(wings: Building, kind: RoomKind) -> None:
    arrangements = {_arrangement(wings, number) for number, room in enumerate(wings.plan.rooms) if room.kind is kind}
    assert len(arrangements) == 1
    assert len(arrangements.pop()) >= 3


def test_what_differs_are_posters_in_a_few_rooms(wings: Building) -> None:
    offices = sum(room.kind is not RoomKind.HALL for room in wings.plan.rooms)
    assert 1 < len(wings.parts.paintings) < offices / 2 + 8


def test_a_tour_goes_through_the_rooms_and_touches_nothing(wings: Building) -> None:
    driven = tour(wings)
    assert driven.collisions <= 1
    # A stop in a small room may be in its door, where the robot arrives from outside.
    assert sum(not driven.images_in(room) for room in wings.plan.rooms) <= 2


def test_wings_are_the_same_on_every_machine(wings: Building) -> None:
    """A change here means other buildings: raise GENERATOR_VERSION."""
    assert digest(wings) == SHA256


def _size(room: Room) -> tuple[float, float]:
    return round(room.x1 - room.x0, 3), round(room.y1 - room.y0, 3)


def _arrangement(wings: Building, number: int) -> tuple[tuple[object, ...], ...]:
    """Return for each piece in a room its kind, place, turn and textures, as seen from the door."""
    room = wings.plan.rooms[number]
    door = next(door for door in wings.plan.doorways if number in door.rooms)
    inside = (p for p in wings.parts.furniture if room.x0 < p.x < room.x1 and room.y0 < p.y < room.y1)
    return tuple(sorted(_from_door(wings, piece, door, room) for piece in inside))


def _from_door(wings: Building, piece: FurniturePiece, door: Doorway, room: Room) -> tuple[object, ...]:
    x, y = door.middle
    half_turn = -1 if door.wall == room.y1 else 1
    numbers = (piece.x - x) * half_turn, (piece.y - y) * half_turn, *(half_turn * part for part in piece.turn)
    textures = tuple(wings.surfaces.face_texture[piece.first_face : piece.end_face].tolist())
    return piece.name.rpartition("-")[0], *(round(number, 3) + 0.0 for number in numbers), textures
