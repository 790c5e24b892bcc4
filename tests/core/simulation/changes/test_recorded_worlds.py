"""A recording knows the world of every moment, and the truth of that moment can be asked."""

from collections.abc import Sequence

import numpy as np
import pytest

from ltvn_core import worlds as w
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.damage.integrity import verify
from ltvn_core.data.recording.drawn_poses import DrawnPoses
from ltvn_core.data.recording.event_drawing import draw_event
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.navigation.events import ChangedBy, StampedEvent, WorldChanged
from ltvn_core.simulation.changes.changed_scenes import ChangedScenes
from ltvn_core.simulation.changes.world_script import MORNING_S, TimedChange, WorldScript
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.worlds import AS_MADE, WorldState

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
