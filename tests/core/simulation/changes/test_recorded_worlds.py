"""A recording knows the world of every moment, and the truth of that moment can be asked."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from ltvn_core import worlds as w
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.event_drawing import draw_event
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import WorldError
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.navigation.events import ChangedBy, StampedEvent, WorldChanged
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, MORNING_S, TimedChange, WorldScript
from ltvn_core.simulation.meshes.mesh_scene import load_mesh_scene
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.worlds import (
    AS_MADE,
    DoorMoved,
    LightChanged,
    PersonMoved,
    ThingKind,
    ThingPlaced,
    ThingRemoved,
    WorldState,
)
from tests.core.simulation.two_room_mesh import box_house, save

SCRIPT = WorldScript(
    "test",
    changes=(
        TimedChange(8 * 3600.0, w.DoorMoved(1, is_open=False)),
        TimedChange(MORNING_S + 0.5, w.DoorMoved(2, is_open=False)),
        TimedChange(MORNING_S + 1.0, w.LightChanged(0.5)),
        TimedChange(MORNING_S + 1.5, w.DoorMoved(2, is_open=True)),
    ),
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Two seconds in a world in which a door was closed already."""
    path = tmp_path_factory.mktemp("world") / "world.rrd"
    simulation = open_simulation("demo", seed=0, script=SCRIPT)
    robot, world = simulation.robot, simulation.world
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:

        def write(events: Sequence[WorldChanged]) -> None:
            for event in events:
                writer.write_event(StampedEvent(robot.step, robot.stamp, event))

        write(world.events())
        world.follow(write)
        writer.write_frame(robot.observe())
        robot.advance(2.0)
        writer.write_frame(robot.observe())
    robot.close()
    return Recording.open(path)


def world_at(recording: Recording, stamp: float) -> WorldState:
    timeline = Timeline.of(recording.events)
    return timeline.progress_before(timeline.count_at(stamp)).world


def test_a_replay_knows_the_world_of_every_moment(recording: Recording) -> None:
    verify(recording.path)
    begun = AS_MADE.after(w.DoorMoved(1, is_open=False))
    assert world_at(recording, 0.0) == begun
    assert world_at(recording, 0.7).closed_doors == {1, 2}
    assert world_at(recording, 1.2).light == w.LightChanged(0.5)
    assert world_at(recording, 2.0) == begun.after(w.LightChanged(0.5))


def test_events_tell_the_time_of_the_world_and_who_changed_it(recording: Recording) -> None:
    events = [stamped.event for stamped in recording.events if isinstance(stamped.event, WorldChanged)]
    assert events[0] == WorldChanged(w.TimePassed(0.0), ChangedBy.SCRIPT, MORNING_S)
    assert [event.at_s for event in events[2:]] == [timed.at_s for timed in SCRIPT.changes[1:]]
    assert all(event.by is ChangedBy.SCRIPT for event in events)


def test_truth_is_asked_of_the_world_as_it_was_then(recording: Recording) -> None:
    scene = load_scene("demo")
    x, y = scene.parts.doors[2].middle
    across = (0.6, 0.0) if scene.parts.doors[2].axis == 0 else (0.0, 0.6)
    poses = {0: np.array([x - across[0], y - across[1], 0.0]), 1: np.array([x + across[0], y + across[1], 0.0])}
    scenes = ChangedScenes(scene)
    for stamp, drivable in ((0.0, True), (0.7, False), (2.0, True)):
        clearance = scenes.at(world_at(recording, stamp)).clearance
        truth = GroundTruth(clearance, recording.observation, poses=poses)
        assert truth.is_spurious((0, 1)) is not drivable


def test_the_viewer_draws_a_closed_door_and_takes_it_away(recording: Recording) -> None:
    doors = [
        stamped.event
        for stamped in recording.events
        if isinstance(stamped.event, WorldChanged) and isinstance(stamped.event.change, w.DoorMoved)
    ]
    _, closed, opened = doors
    assert closed.outline is not None
    assert opened.outline is None
    for event in (closed, opened):
        entities = [drawn.entity for drawn in draw_event(event, DrawnPoses())]
        assert entities == [schema.LOG, f"{schema.CHANGES}/door_2"]


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
