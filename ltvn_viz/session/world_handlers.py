"""Runs the commands that change the simulated world, and reports the results. In the session's thread only."""

from typing import assert_never

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.navigation.events import Severity
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.goal_handlers import drive_to
from ltvn_viz.session.story_teller import StoryTeller
from ltvn_viz.wishes import commands as c


def change_world(state: AppState, command: c.WorldCommand) -> None:
    """Queue a change of the world. Raises OptionError without a simulated world."""
    if state.world is None:
        raise OptionError("Only a simulated world can be changed here; this robot drives in a real one.")
    match command:
        case c.ToggleDoor(door):
            state.world.toggle_door(door)
        case c.AimBox(number):
            state.world.aim_box(number)
        case c.PutBox(place):
            state.world.put_box(place)
        case c.TakeBox(number):
            state.world.take_box(number)
        case c.SetLight(percent):
            state.world.set_light(percent / 100)
        case c.UndoWorldChange():
            state.world.undo()
        case c.WatchItLearn():
            state.end_steps("another story begins")
            if state.story is not None:
                state.story.close()
            state.story = StoryTeller(state.live, state.live_map, state.world)
        case _:
            assert_never(command)


def carry_out_changes(state: AppState) -> None:
    """Apply the queued changes; while the navigator is computing, they wait for a later tick."""
    if state.world is None or (isinstance(state.activity, Navigation) and state.activity.is_thinking):
        return
    try:
        done = state.world.carry_out()
    except LtvnError as error:
        state.say(str(error), Severity.ERROR)
        return
    is_told = state.story is not None and not state.story.is_over
    if done and not is_told:
        state.say(f"{done[-1][:1].upper()}{done[-1][1:]}.")


def go_on_with_story(state: AppState) -> None:
    """Continue the running story; after its end, restore what it changed as soon as nothing uses the map."""
    story = state.story
    if story is None or isinstance(state.activity, Playback | MapBuilding):
        return
    is_idle = state.activity is state.teleop
    if story.is_over:
        if is_idle and not state.worker.pending:
            story.close()
        return
    if story.lead() or state.worker.pending or state.teleop.is_mapping:
        return
    match story.tick(is_idle=is_idle):
        case c.NavigateTo(node) if node is not None:
            drive_to(state, node)
        case c.Cancel() if isinstance(state.activity, Navigation):
            state.activity.cancel()  # The story gives the reason, so nothing is reported as cancelled.
        case _:
            pass
