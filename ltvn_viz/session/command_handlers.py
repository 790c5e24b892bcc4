"""Runs the commands of the page: finds the function of each wish in the table, and refuses what is not legal now.

Owns the commands that carry more than a wish, and the questions. Runs in the session's thread only.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from operator import attrgetter
from pkgutil import resolve_name
from typing import Any, assert_never

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.navigation.events import Severity
from ltvn_core.types import NodeId
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.goal_handlers import find_and_go, find_place
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.seeking import seek
from ltvn_viz.session.snapshot import JobProgress
from ltvn_viz.session.world_handlers import change_map
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import DRIVING, STANDING
from ltvn_viz.wishes.wish import Wish
from ltvn_viz.wishes.wish_table import Action

_RULES: Mapping[type[c.Command], Wish] = {
    c.OpenRecording: Action.OPEN.wish,
    c.Seek: Action.SEEK.wish,
    c.NavigateToImage: Wish("", STANDING, "", "upload an image"),
    c.EditMap: Wish("", DRIVING, "", "change the map by hand"),
}
"""The rules for commands that are no wishes; all others are legal in every mode."""


def handle(state: AppState, command: c.Command) -> None:
    """Run a command, or show the reason why it cannot be run."""
    wish = command.action.wish if isinstance(command, c.Ask) else _RULES.get(type(command))
    if wish is not None and (why_not := wish.refusal(state.activity.mode)) is not None:
        state.say(why_not, Severity.WARN)
        return
    try:
        if isinstance(command, c.Ask):
            follows = function_of(command.action)(state, command.value)
        else:
            follows = _carry_out(state, command)
    except OptionError as error:
        state.say(str(error), Severity.WARN)  # The request is at fault; the app itself is well.
    except LtvnError as error:
        state.say(str(error), Severity.ERROR)
    else:
        if follows is not None:
            handle(state, follows)


def _carry_out(state: AppState, command: c.OtherCommand) -> c.Command | None:
    """Run a command that is no wish, and return the one that follows it, if any."""
    match command:
        case c.PointAt(node, target):
            state.debugger.point_at(node, target)
        case c.AskQuestion(request):
            return state.debugger.handle_request(request)
        case c.AskAbout(question, edge, request, at_s):
            if at_s is not None:
                handle(state, c.Seek(at_s))
            choose_question(state, question)
            if edge is not None:
                state.debugger.point_at(*edge)
            if request is not None:
                return state.debugger.handle_request(request)
        case c.EditMap(deltas):
            change_map(state, deltas)
        case c.OpenRecording(name, at_s, then):
            open_recording(state, name, at_s, then)
        case c.Seek(time_s):
            seek(state, time_s)
        case c.NavigateToImage(rgb, original):
            if isinstance(state.activity, Playback):
                find_place(state, state.activity, rgb if original is None else original)
            else:
                find_and_go(state, rgb, original)
        case c.ReportError(text):
            # The user's file is at fault; the app itself continues.
            state.say(text, Severity.WARN, title="Problem")
        case _:
            assert_never(command)
    return None


@cache
def function_of(action: Action) -> Callable[[AppState, c.Value], c.Command | None]:
    """Return what fulfils a wish, as a function of the state and the wish's value; the page's own wishes do nothing."""
    wish = action.wish
    if not wish.does:
        return lambda _state, _value: None
    function = _named(wish.does)
    if wish.given is not None:
        return lambda state, _: function(state, wish.given)
    return function if wish.takes is not None else lambda state, _: function(state)


def _named(does: str) -> Callable[..., Any]:
    if ":" in does:
        return resolve_name(f"{__package__}.{does}")
    method = attrgetter(does)
    return lambda state, *value: method(state)(*value)


def choose_question(state: AppState, name: str) -> None:
    """Show a question and count it in the recording; an unknown name asks nothing."""
    word, known = next((each for each in state.debugger.words.items() if each[1] == name), ("", QuestionName.FIRST))
    state.debugger.choose(known)
    if word:
        state.live.recorder.write_question(word)


def pick_edge(state: AppState, ends: tuple[NodeId, NodeId]) -> None:
    """Ask about an edge, by the question on show if there is one."""
    if not state.debugger.is_on:
        choose_question(state, QuestionName.EDGE)
    state.debugger.point_at(*ends)


def follow(state: AppState, number: int) -> c.Command:
    """Return the command of a link in the answer."""
    return state.debugger.link(number) or c.ReportError(
        "That answer was replaced before your click arrived. Click in the new answer."
    )


def open_recording(state: AppState, name: str, at_s: float = 0.0, then: Sequence[c.Command] = ()) -> None:
    """Stop the robot, open a recording, show it at a time and run the next commands, unless a query began meanwhile."""

    def show(replay: Playback) -> None:
        state.work = None
        if isinstance(state.activity, Navigation | MapBuilding):
            state.say(f"{name} was not opened, because a query began meanwhile. Open it when that is over.")
            return
        replay.breakpoint_monitor = state.live.breakpoint_monitor
        replay.seek(at_s)
        state.activity = replay
        for each in then:
            handle(state, each)

    state.live.robot.stop()
    state.work = JobProgress(f"Opening {name}")
    state.worker.submit(lambda: state.open_replay(name), show)
