"""Runs the commands that change the simulated world, and reports the results. In the session's thread only."""

from collections.abc import Sequence

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.evaluation.door_story.story_map import NO_STORY, why_no_story
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Severity
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.goal_handlers import drive_to
from ltvn_viz.session.story_teller import StoryTeller
from ltvn_viz.wishes import commands as c


def begin_story(state: AppState) -> None:
    """Close a door on a planned path, let the robot discover it, open the door again, and show what the map learned.

    Raises OptionError if no story can be played here.
    """
    world = state.changeable
    if why_not := no_story(state):
        raise OptionError(why_not)
    state.end_steps("another story begins")
    if state.story is not None:
        state.story.close()
    state.story = StoryTeller(state.live, state.live_map, world)


def use_alignment(state: AppState) -> None:
    """Keep the floor plan as it lies now. Raises OptionError without a plan, or with too few clicks."""
    state.plan_clicks.use()
    state.say("The floor plan is aligned. “World” shows the option that gives the same alignment next time.")


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


def no_story(state: AppState) -> str:
    """Return why “Watch it learn” cannot be played, and what to do; empty if it can."""
    live_map = state.live_map
    if state.world is None:
        return NO_STORY
    return why_no_story(state.world.world.base, live_map.graph, live_map.keyframes.observation)


def change_map(state: AppState, deltas: Sequence[GraphDelta]) -> None:
    """Change the map by hand, in the worker's thread."""

    def show(changed: Sequence[GraphDelta]) -> None:
        state.live.emit_changes(changed)
        state.debugger.take_in_all_events()

    state.worker.submit(lambda: state.live_map.change(deltas), show)


def go_on_with_story(state: AppState) -> None:
    """Continue the running story; after its end, restore what it changed as soon as nothing uses the map."""
    story = state.story
    if story is None or isinstance(state.activity, Playback | MapBuilding):
        return
    is_idle = state.activity is state.teleop
    if story.is_over:
        if is_idle and not state.worker.pending:
            if deltas := story.leftovers():
                change_map(state, deltas)
            else:
                story.close()
        return
    if story.lead() or state.worker.pending or state.teleop.is_mapping:
        return
    match story.tick(is_idle=is_idle):
        case c.Ask(c.Action.GOAL, int() as node):
            drive_to(state, node)
        case c.EditMap(deltas):
            change_map(state, deltas)
        case _:
            pass
