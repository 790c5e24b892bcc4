"""Two rooms side by side with two doors between them: the smallest scene with two ways, and a map of one of them."""

import itertools
from pathlib import Path

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.data.recording.recorded_run import RunDescription
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.simulation.apartments.floor_plan import FloorPlan, OccupancyGrid
from ltvn_core.simulation.apartments.materials import choose_apartment_materials, choose_room_materials
from ltvn_core.simulation.apartments.room_shell import RoomShell, wall_sides
from ltvn_core.simulation.apartments.seeded_rng import SeededRng
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.rooms import Doorway, Room, RoomKind, SceneParts
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scripted_tour import TourSettings, drive_along
from ltvn_core.simulation.surfaces import SurfaceBuilder

NAME = "two-doors"
WIDTH_M, DEPTH_M = 4.6, 4.2
_MIDDLE_M = WIDTH_M / 2
DOORWAYS = (
    Doorway(rooms=(0, 1), axis=0, wall=_MIDDLE_M, low=0.4, high=1.3),
    Doorway(rooms=(0, 1), axis=0, wall=_MIDDLE_M, low=2.9, high=3.8),
)
WAY = (
    *((0.8, 2.0), (0.9, 0.85), (3.7, 0.85), (3.8, 2.2), (3.1, 1.9), (3.1, 0.85)),
    *((0.9, 0.85), (0.7, 2.6), (0.9, 0.85), (1.7, 0.95), (1.5, 1.7)),
)
"""Through the first door, there and back, x and y in metres; it comes near its end only there."""


def two_door_scene() -> Scene:
    """Return the scene, unfurnished."""
    rooms = (
        Room(RoomKind.LIVING, 0.0, 0.0, _MIDDLE_M, DEPTH_M),
        Room(RoomKind.KITCHEN, _MIDDLE_M, 0.0, WIDTH_M, DEPTH_M),
    )
    plan, rng, builder = (
        FloorPlan(WIDTH_M, DEPTH_M, rooms, DOORWAYS),
        SeededRng(np.random.default_rng(3)),
        SurfaceBuilder(),
    )
    occupancy = OccupancyGrid(plan)
    shell = RoomShell(builder, occupancy, rng.spawn(), choose_apartment_materials(builder, rng.spawn()), 2.5)
    for index, room in enumerate(rooms):
        style = choose_room_materials(builder, rng.spawn(), room.kind, 0.1 + 0.5 * index)
        sides = wall_sides(plan, index)
        shell.draw(room, sides, style)
        for side in sides:
            shell.add_decoration(room, side, [])
    return Scene(
        name=NAME,
        area_m2=WIDTH_M * DEPTH_M,
        rooms=rooms,
        clearance=ClearanceMap(occupancy.blocked, occupancy.origin),
        surfaces=builder.build(),
        parts=SceneParts(doorways=DOORWAYS),
    )


def write_map(path: Path) -> None:
    """Drive through the first door and back, and write the map that grows from it by the simulator's own geometry."""
    simulation = open_simulation(NAME, seed=0, start=np.array([*WAY[0], -np.pi / 2]))
    predictor = open_predictor("oracle", NAME, None, camera=simulation.robot.spec.camera)
    system, keyframes, graph = ltvn_system(ROBUST), KeyframeStore(predictor), TopologicalGraph()
    assert system.online is not None
    online = system.online(graph, keyframes, predictor)
    corners = np.array(WAY)
    way = np.concatenate([np.linspace(a, b, 20) for a, b in itertools.pairwise(corners)])
    for observation in drive_along(simulation.robot, simulation.scene, way, TourSettings(image_every_m=0.25)):
        for delta in online.offer(observation):
            graph.apply(delta)
    simulation.robot.close()
    run = RunDescription(
        scene=NAME,
        config={"verb": "collect", "system": system.name},
        fingerprint=predictor.fingerprint,
        camera=simulation.robot.spec.camera,
    )
    run.save_map(path, graph, [keyframes.observation(frame) for frame in (*graph.nodes, *graph.reserve)])
