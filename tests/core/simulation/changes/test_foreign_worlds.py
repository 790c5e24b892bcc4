"""A scene that nobody here made gets things, light and people, too, but no doors of its own."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import WorldError
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S
from ltvn_core.simulation.meshes.mesh_scene import load_mesh_scene
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.worlds import DoorMoved, LightChanged, PersonMoved, ThingKind, ThingPlaced, ThingRemoved
from tests.core.simulation.two_room_mesh import box_house, save


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save(box_house(), tmp_path_factory.mktemp("house") / "house.glb")


@pytest.fixture(scope="module")
def scene(house: Path) -> Scene:
    return load_mesh_scene(house)


@pytest.mark.parametrize(
    ("name", "brings"), [("moving", ThingPlaced), ("light", LightChanged), ("people", PersonMoved)]
)
def test_two_days_pass_in_a_foreign_house(scene: Scene, name: str, brings: type) -> None:
    world = World(scene, make_script(name, scene, seed=1, duration_s=2 * DAY_S))
    kinds: set[type] = set()
    for _ in range(8):
        world.skip(5 * HOUR_S)
        kinds |= {type(event.change) for event in world.events()}
        assert np.count_nonzero(world.scene.clearance.navigable) > 0.6 * np.count_nonzero(scene.clearance.navigable)
    assert brings in kinds


@pytest.mark.parametrize("name", ["doors", "daily", "telegraph"])
def test_a_script_of_doors_says_that_there_are_none(scene: Scene, name: str) -> None:
    with pytest.raises(WorldError, match="has no doors"):
        make_script(name, scene)


def test_a_robot_in_a_mesh_meets_a_box_and_sees_it_get_dark(scene: Scene) -> None:
    world, noise = World(scene), np.random.default_rng(0)
    robot = SimulatedRobot(
        scene, EmbreeRenderer(scene.surfaces), start=np.array([0.6, 2.0, 0.0]), rng=noise, world=world
    )
    before = robot.observe()
    robot.apply(ThingPlaced("parcel", ThingKind.BOX, (1.8, 2.0, 0.0), (0.4, 0.4, 0.8)))
    seen = robot.observe()
    assert before.depth is not None
    assert seen.depth is not None
    assert seen.depth[36, 48] == pytest.approx(1.0, abs=0.01)
    assert before.depth[36, 48] > 2.0
    robot.apply(LightChanged(0.3))
    assert robot.observe().rgb.mean() < 0.4 * seen.rgb.mean()
    robot.apply(ThingRemoved("parcel"))
    robot.apply(LightChanged(1.0))
    assert np.array_equal(robot.observe().rgb, before.rgb)
    with pytest.raises(WorldError, match="have no doors"):
        robot.apply(DoorMoved(0, is_open=False))
    robot.close()


def test_a_simulation_of_a_mesh_has_a_world(house: Path, scene: Scene) -> None:
    simulation = open_simulation(str(house), seed=0, script=make_script("people", scene, seed=0))
    simulation.robot.advance(1.0)
    assert len(simulation.world.state.people) == 3
    simulation.robot.close()
