"""A shop has rows of tall shelves, a robot drives along all of them, and its goods make them differ."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.apartments.shop import generate_shop, generate_shop_plan
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rooms import FurniturePiece, RoomKind
from tests.core.simulation.toured_building import digest, tour, unreachable_share

SEED, AREA_M2 = 11503, 560.0
SHA256 = "3955a76f201848606b1d001b94adae7012b9d34af5fce3c2dbeec89bed7d07c0"


@pytest.fixture(scope="module")
def shop() -> Building:
    return generate_shop(SEED, AREA_M2)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(200, 800))
def test_the_parts_of_every_shop_cover_its_floor_and_are_open_to_each_other(seed: int, area_m2: float) -> None:
    plan = generate_shop_plan(SeededRng(np.random.default_rng(seed)), area_m2)
    zones = [zone for hall in plan.walls.rooms for zone in plan.zones(hall)]
    assert plan.walls.width * plan.walls.depth == pytest.approx(area_m2, rel=0.02)
    assert sum(zone.area_m2 for zone in zones) == pytest.approx(plan.walls.width * plan.walls.depth)
    assert len(plan.walls.rooms) == (1 if area_m2 <= 400 else 2)
    assert all(zone.shorter_side_m > 1.6 for zone in zones)


@settings(max_examples=4)
@given(seed=st.integers(0, 2**31), area_m2=st.floats(200, 800))
def test_a_robot_gets_everywhere_in_every_shop(seed: int, area_m2: float) -> None:
    assert unreachable_share(generate_shop(seed, area_m2)) < 0.01


def test_aisles_between_shelves_are_as_wide_as_in_shops(shop: Building) -> None:
    clearance = ClearanceMap(shop.blocked, shop.origin)
    aisles = [room for room in shop.plan.rooms if room.kind is RoomKind.AISLE]
    assert len(aisles) >= 8
    for aisle in aisles:
        row = round(((aisle.y0 + aisle.y1) / 2 - clearance.origin[1]) / clearance.resolution_m)
        columns = ((np.array([aisle.x0, aisle.x1]) - clearance.origin[0]) / clearance.resolution_m).astype(int)
        free_m = np.count_nonzero(~shop.blocked[row, slice(*columns)]) * clearance.resolution_m
        assert 1.3 <= free_m <= 2.0


def test_shelves_are_tall_and_hardly_two_look_the_same(shop: Building) -> None:
    shelves = [piece for piece in shop.parts.furniture if piece.name.startswith("goods-shelf")]
    assert len(shelves) > 60
    assert all(1.8 - 1e-6 <= _height_m(shop, shelf) <= 2.2 for shelf in shelves)
    looks = [tuple(shop.surfaces.face_texture[shelf.first_face : shelf.end_face]) for shelf in shelves]
    alike = sum(a == b for a, b in combinations(looks, 2))
    assert alike < 3


def test_a_tour_goes_through_every_aisle_and_touches_nothing(shop: Building) -> None:
    driven = tour(shop)
    assert driven.collisions <= 1
    assert all(driven.images_in(room) for room in shop.plan.rooms)


def test_a_shop_is_the_same_on_every_machine(shop: Building) -> None:
    """A change here means other shops: raise GENERATOR_VERSION."""
    assert digest(shop) == SHA256


def _height_m(shop: Building, piece: FurniturePiece) -> float:
    faces = shop.surfaces.faces[piece.first_face : piece.end_face]
    return float(shop.surfaces.vertices[faces][..., 2].max())
