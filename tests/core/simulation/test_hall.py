"""A hall is wide and open, its islands leave ways between them, and small rooms lie along one side."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.hall import OPEN_ISLANDS, generate_hall, generate_hall_plan
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rooms import RoomKind
from tests.core.simulation.toured_building import digest, in_room, tour, unreachable_share

SEED, AREA_M2 = 12503, 600.0
SHA256 = "1eea4386b1198a5525ac2b5c13574f1dcb5ee0d40f981c1de2833ec11e2602ff"


@pytest.fixture(scope="module")
def hall() -> Building:
    return generate_hall(SEED, AREA_M2)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(300, 650))
def test_every_hall_takes_most_of_the_floor_and_has_a_door_to_each_small_room(seed: int, area_m2: float) -> None:
    plan = generate_hall_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    hall, *small = plan.rooms
    assert plan.width * plan.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(plan.width * plan.depth)
    assert hall.area_m2 > 0.7 * area_m2
    assert 2 <= len(small) <= 4
    assert sorted(door.rooms for door in plan.doorways) == [(0, number + 1) for number in range(len(small))]
    assert all(0.9 <= door.width_m < 1.0 for door in plan.doorways)


@settings(max_examples=5)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(300, 650))
def test_a_robot_gets_everywhere_in_every_hall(seed: int, area_m2: float) -> None:
    assert unreachable_share(generate_hall(seed, area_m2)) < 0.01


def test_most_of_the_hall_is_free_floor_with_wide_ways(hall: Building) -> None:
    clearance = ClearanceMap(hall.blocked, hall.origin)
    wide = clearance.origin + (np.argwhere(clearance.grid > 0.5)[:, ::-1] + 0.5) * clearance.resolution_m
    parts = [room for room in hall.plan.rooms if room.kind is RoomKind.HALL]
    assert len(parts) >= 8
    for part in parts:
        assert in_room(wide, part).sum() * clearance.resolution_m**2 > 0.3 * part.area_m2


def test_all_parts_of_a_hall_are_open_to_each_other_and_only_small_rooms_have_doors(hall: Building) -> None:
    small = [number for number, room in enumerate(hall.plan.rooms) if room.kind is not RoomKind.HALL]
    assert sorted(max(door.rooms) for door in hall.parts.doors) == small
    reached = {0}
    for _ in hall.plan.rooms:
        reached |= {room for door in hall.parts.doorways if reached & set(door.rooms) for room in door.rooms}
    assert reached == set(range(len(hall.plan.rooms)))


def test_posters_and_islands_are_about(hall: Building) -> None:
    assert len(hall.parts.paintings) > 15
    islands = ("table-with-chairs", "desk-group", "sofa")
    assert sum(piece.name.startswith(islands) for piece in hall.parts.furniture) >= 8


def test_a_tour_goes_through_all_parts_and_touches_nothing(hall: Building) -> None:
    driven = tour(hall)
    assert driven.collisions <= 1
    assert all(driven.images_in(room) for room in hall.plan.rooms)


def test_a_hall_is_the_same_on_every_machine(hall: Building) -> None:
    """A change here means other halls: raise GENERATOR_VERSION."""
    assert digest(hall) == SHA256


@pytest.mark.parametrize("seed", [14500, 14501])
def test_under_the_furniture_of_an_open_hall_there_is_floor_that_a_locobot_does_not_fit_on(seed: int) -> None:
    building = generate_hall(seed, 320.0, OPEN_ISLANDS)
    clearance = ClearanceMap(building.blocked, building.origin)
    low = [piece for piece in building.parts.furniture if piece.name.startswith(("open-", "bar-"))]
    assert len(low) >= 6
    assert all(clearance.at(np.array([[piece.x, piece.y]]))[0] == 0 for piece in low)
    assert unreachable_share(building) < 0.01
