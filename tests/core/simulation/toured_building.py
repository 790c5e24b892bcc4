"""A generated building as a scene, a round of a mapping tour through it, and what makes it this building."""

import hashlib
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.apartments.generation import Building
from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.rooms import Room
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scripted_tour import drive_tour
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from tests.core.simulation.fake_scene import GreyCamera


@dataclass(frozen=True)
class Round:
    """What came of one round of a tour."""

    places: NDArray[np.float64]
    """(N, 2) where images were taken."""
    collisions: int

    def images_in(self, room: Room) -> int:
        """Return how many images were taken in a room."""
        return int(in_room(self.places, room).sum())


def tour(building: Building) -> Round:
    """Drive one round through a building with the body that every machine has."""
    clearance = ClearanceMap(building.blocked, building.origin)
    scene = Scene(
        name="building",
        area_m2=building.plan.width * building.plan.depth,
        rooms=building.plan.rooms,
        clearance=clearance,
        surfaces=building.surfaces,
        parts=building.parts,
    )
    rng = np.random.default_rng(0)
    start = clearance.sample_poses(rng, 1, min_clearance_m=0.35)[0]
    with closing(SimulatedRobot(scene, GreyCamera(), start=start, rng=rng, body="planar")) as robot:
        poses = [observation.exact_pose for observation in drive_tour(robot, scene, rng, loops=1)]
        return Round(np.array(poses)[:, :2], robot.collisions)


def unreachable_share(building: Building) -> float:
    """Return how much floor would be free for a robot that never gets there, as a share of what it can reach."""
    clearance = ClearanceMap(building.blocked, building.origin)
    free = np.count_nonzero(clearance.grid > PLANNING_CLEARANCE_M)
    return free / np.count_nonzero(clearance.navigable) - 1


def in_room(places: NDArray[np.float64], room: Room) -> NDArray[np.bool_]:
    """Return which places (N, 2) lie in a room."""
    return np.asarray(((places > (room.x0, room.y0)) & (places < (room.x1, room.y1))).all(1), bool)


def digest(building: Building) -> str:
    """Return a hash of all that is seen of a building and of its free floor."""
    surfaces = building.surfaces
    shape = surfaces.vertices.astype("<f4"), surfaces.faces.astype("<i4"), building.blocked.astype(np.uint8)
    looks = surfaces.corner_uv.astype("<f4"), surfaces.face_texture.astype("<i4")
    arrays = (*shape, *looks, *surfaces.textures)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
