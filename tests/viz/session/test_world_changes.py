"""A person changes the simulated world from the page: what the robot meets, what is shown, and what is refused."""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.analysis.manual_edits import connect_by_action
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import WorldError
from ltvn_core.graph.deltas import Cause, NodeAdded, NodeDropped
from ltvn_core.graph.operators import node_from_observation
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import ChangedBy, WorldChanged
from ltvn_core.types import NodeId, Pose
from ltvn_core.worlds import DoorMoved
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.snapshot import WorldView
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.app_session import AppSession
from tests.viz.session_harness import said
from tests.waiting import until

pytest.importorskip("embreex")


class ApartmentSession(AppSession):
    """A session in the demo apartment, and what its page shows."""

    @property
    def view(self) -> WorldView:
        view = self.now.world
        assert view is not None
        return view

    def changes(self) -> list[WorldChanged]:
        events = (stamped.event for stamped in self.state.live.timeline.events)
        return [event for event in events if isinstance(event, WorldChanged)]


@pytest.fixture(scope="module")
def apartment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ApartmentSession]:
    options = AppOptions(predictor="oracle", recordings=tmp_path_factory.mktemp("recordings"))
    with ExitStack() as stack:
        opened = ApartmentSession(stack, options)
        opened.do()
        yield opened


@pytest.fixture(autouse=True)
def as_made(apartment: ApartmentSession) -> None:
    while apartment.do().world != (fresh := apartment.view) or fresh.undo:
        apartment.do(c.Ask(c.Action.UNDO_CHANGE))


def test_a_door_that_is_closed_by_hand_is_closed_for_the_robot_and_on_the_page(apartment: ApartmentSession) -> None:
    door = apartment.view.doors[0]
    before = apartment.state.live.robot.observe()
    shown = apartment.do(c.Ask(c.Action.DOOR, door.door))
    assert not apartment.view.doors[0].is_open
    assert shown.moment.progress.world.closed_doors == {door.door}
    assert door.label in said(shown)
    assert apartment.changes()[-1].change == DoorMoved(door.door, is_open=False)
    assert apartment.changes()[-1].by is ChangedBy.HAND
    assert apartment.state.live.robot.observe().step > before.step
    world = apartment.state.world
    assert world is not None
    assert world.world.scene.clearance.at(np.array([door.x, door.y])) == 0
    apartment.do(c.Ask(c.Action.DOOR, door.door))
    assert apartment.view.doors[0].is_open


def test_a_change_that_would_hit_the_robot_is_refused_in_words(apartment: ApartmentSession) -> None:
    pose = apartment.state.live.robot.drawn_pose
    shown = apartment.do(c.Ask(c.Action.PUT_BOX, (float(pose[0]), float(pose[1]))))
    assert "the robot is there" in said(shown)
    assert shown.moment.progress.world.things == ()
    assert not apartment.view.undo


def numbers(apartment: ApartmentSession) -> list[int]:
    return [each.number for each in apartment.view.boxes]


def test_a_box_waits_for_its_place_on_the_floor_and_is_moved_to_another(apartment: ApartmentSession) -> None:
    near, far = ((each.x + 0.5 * (not each.along_x), each.y + 0.5 * each.along_x) for each in apartment.view.doors[:2])
    apartment.do(c.Ask(c.Action.AIM_BOX, 0))
    assert apartment.view.aimed == 0
    apartment.do(c.Ask(c.Action.AIM_BOX, 0))
    assert apartment.view.aimed is None, "asked for again it waits no longer"
    apartment.do(c.Ask(c.Action.AIM_BOX, 0))
    apartment.do(c.Ask(c.Action.PUT_BOX, near))
    assert apartment.view.aimed is None
    apartment.do(c.Ask(c.Action.AIM_BOX, 1))
    shown = apartment.do(c.Ask(c.Action.PUT_BOX, far))
    assert numbers(apartment) == [1]
    assert shown.moment.progress.world.things[0].pose[:2] == pytest.approx(far)
    apartment.do(c.Ask(c.Action.AIM_BOX, 1), c.Ask(c.Action.TAKE_BOX, 1))
    assert apartment.view.aimed is None, "what is gone waits for nothing"
    refused = apartment.do(c.Ask(c.Action.AIM_BOX, 7))
    assert "no box 7" in said(refused)


def test_a_box_is_put_down_and_taken_away_and_each_change_is_undone(apartment: ApartmentSession) -> None:
    door = apartment.view.doors[1]
    place = door.x + (0.0 if door.along_x else 0.4), door.y + (0.4 if door.along_x else 0.0)
    apartment.do(c.Ask(c.Action.PUT_BOX, place))
    assert numbers(apartment) == [1]
    apartment.do(c.Ask(c.Action.TAKE_BOX, 1))
    assert numbers(apartment) == []
    shown = apartment.do(c.Ask(c.Action.UNDO_CHANGE))
    assert shown.moment.progress.world.things[0].pose[:2] == place
    apartment.do(c.Ask(c.Action.UNDO_CHANGE))
    assert numbers(apartment) == []
    apartment.do(c.Ask(c.Action.UNDO_CHANGE))
    assert "nothing to undo" in (apartment.now.message or pytest.fail("nothing was said")).text


def test_darker_light_makes_the_robots_image_darker(apartment: ApartmentSession) -> None:
    robot = apartment.state.live.robot
    before = robot.observe().rgb.mean()
    apartment.do(c.Ask(c.Action.LIGHT, 50))
    assert robot.observe().rgb.mean() == pytest.approx(before / 2, rel=0.05)


def test_a_recording_that_begins_later_tells_what_the_world_is_like(apartment: ApartmentSession) -> None:
    door = apartment.view.doors[0].door
    apartment.do(c.Ask(c.Action.DOOR, door))
    apartment.do(c.Ask(c.Action.RECORD))
    until(lambda: apartment.do().recording.name is not None)
    apartment.do(c.Ask(c.Action.DOOR, door))
    apartment.do(c.Ask(c.Action.KEEP))
    until(lambda: apartment.do().recording.name is None)
    path = next(iter(apartment.state.library.folder.glob("*.rrd")))
    changes = [each.event.change for each in Recording.open(path).events if isinstance(each.event, WorldChanged)]
    assert changes[-2:] == [DoorMoved(door, is_open=False), DoorMoved(door, is_open=True)]


def test_in_another_map_the_story_names_the_command_that_opens_its_own_and_changes_nothing(
    apartment: ApartmentSession,
) -> None:
    system = apartment.state.live_map.system
    assert "ltvn app" in apartment.do().no_story
    shown = apartment.do(c.Ask(c.Action.WATCH_IT_LEARN))
    assert "ltvn app" in said(shown)
    assert shown.story == ()
    assert apartment.state.live_map.system is system
    assert all(each.is_open for each in apartment.view.doors)


def test_a_script_of_changes_runs_in_the_page_from_the_beginning(tmp_path: Path) -> None:
    script = tmp_path / "evening.json"
    changes = [{"at_s": 0, "change": "DoorMoved", "door": 0, "is_open": False}]
    changes.append({"at_s": 32400.5, "change": "LightChanged", "level": 0.5})
    script.write_text(json.dumps({"name": "evening", "changes": changes}), encoding="utf-8")
    options = AppOptions(predictor="oracle", recordings=tmp_path / "recordings", world=str(script))
    with ExitStack() as stack:
        app = ApartmentSession(stack, options)
        app.do()
        assert not app.view.doors[0].is_open
        assert app.view.light == 1.0
        until(lambda: app.do().world is not None and app.view.light == 0.5)
        assert {each.by for each in app.changes()} == {ChangedBy.SCRIPT}


def test_a_script_that_is_none_is_refused_before_the_page_opens(tmp_path: Path) -> None:
    options = AppOptions(predictor="oracle", recordings=tmp_path, world="sometimes")
    with ExitStack() as stack, pytest.raises(WorldError, match="sometimes"):
        open_app_state(options, stack)


@pytest.mark.parametrize("away_m", [0.0, 1e3], ids=["in the scene", "outside of it"])
def test_a_simulated_robot_is_put_where_an_action_ends_if_it_can_stand_there(
    apartment: ApartmentSession, away_m: float
) -> None:
    state, world = apartment.state, apartment.state.world
    assert world is not None
    start, end = world.world.scene.clearance.sample_poses(np.random.default_rng(0), 2, min_clearance_m=0.4)
    nodes = [add_node(apartment, end, away_m), add_node(apartment, start, 0.0)]
    apartment.do(c.EditMap(connect_by_action(state.live_map.graph, nodes[1], nodes[0], "Take the lift")))
    until(lambda: state.live_map.graph.edges, meanwhile=apartment.session.tick)
    apartment.do(c.Ask(c.Action.GOAL, nodes[0]))
    until(lambda: state.actions.state() is ActionState.PENDING, meanwhile=apartment.session.tick)
    apartment.do(c.Ask(c.Action.END_ACTION, 1))
    until(lambda: apartment.now.waiting is None, meanwhile=apartment.session.tick)
    stands = end if not away_m else start
    np.testing.assert_allclose(state.live.robot.drawn_pose[:2], stands[:2], atol=0.3)
    message = apartment.now.message
    assert (message is not None and "stays" in message.text) == bool(away_m)
    apartment.do(c.Ask(c.Action.CANCEL))
    until(lambda: apartment.session.state.activity.mode is Mode.TELEOP, meanwhile=apartment.session.tick)
    apartment.do(c.EditMap(tuple(NodeDropped(node, Cause.HAND) for node in nodes)))


def add_node(apartment: ApartmentSession, pose: Pose, away_m: float) -> NodeId:
    """Put the robot at a pose (3,) and add its image to the map, as if it was taken `away_m` metres away."""
    state = apartment.state
    assert state.world is not None
    state.world.carry(pose)
    seen = replace(state.live.capture(), exact_pose=pose + np.array([away_m, 0.0, 0.0]))
    state.live_map.keyframes.add([seen])
    state.live_map.change([NodeAdded(node_from_observation(seen), Cause.HAND)])
    return seen.step
