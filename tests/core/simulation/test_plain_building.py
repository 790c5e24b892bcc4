"""A plain building is drivable and shows nothing but bare walls."""

import hashlib

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.apartments.plain_building import generate_plain_building
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.rooms import RoomKind

SEED, AREA_M2 = 8203, 200.0
SHA256 = "2d9412b690b8da0bd4ca29eab26def2c1914962700ca869208f303a0c7b0685e"


@pytest.fixture(scope="module")
def building() -> Building:
    return generate_plain_building(SEED, AREA_M2)


def test_a_robot_gets_everywhere_and_the_area_is_as_asked(building: Building) -> None:
    clearance = ClearanceMap(building.blocked, building.origin)
    assert np.count_nonzero(clearance.grid > PLANNING_CLEARANCE_M) < 1.01 * np.count_nonzero(clearance.navigable)
    assert building.plan.width * building.plan.depth == pytest.approx(AREA_M2, rel=0.02)
    assert len(building.plan.rooms) >= 10


def test_walls_are_bare_and_most_rooms_empty(building: Building) -> None:
    assert building.parts.paintings == building.parts.rugs == ()
    furnished = {RoomKind.KITCHEN, RoomKind.BATH}
    for room in building.plan.rooms:
        inside = [p for p in building.parts.furniture if room.x0 < p.x < room.x1 and room.y0 < p.y < room.y1]
        assert not inside or room.kind in furnished
    assert len(np.unique(_wall_textures(building))) == 1


def test_a_plain_building_is_the_same_on_every_machine(building: Building) -> None:
    """A change here means other buildings: raise GENERATOR_VERSION."""
    assert _digest(building) == SHA256


def _digest(building: Building) -> str:
    surfaces = building.surfaces
    arrays = (
        surfaces.vertices.astype("<f4"),
        surfaces.faces.astype("<i4"),
        surfaces.corner_uv.astype("<f4"),
        building.blocked.astype(np.uint8),
        *surfaces.textures,
    )
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def _wall_textures(building: Building) -> NDArray[np.int32]:
    """Return the textures of all upright triangles that reach from the floor to the ceiling."""
    corners = building.surfaces.vertices[building.surfaces.faces]
    upright = np.ptp(corners[..., 2], axis=1) > 2.4
    return building.surfaces.face_texture[upright]
