"""The Why tab of a page that only watches: its own question, selection and answers.

A watching page shows the driver's question until it asks its own; then it has its own view until it closes the question
or takes the seat. Owns the check of its commands: commands with effects on other pages are refused, and only the asking
page shows the reason. Runs in the session's thread.
"""

from collections.abc import Set

from ltvn_core.errors import LtvnError
from ltvn_core.types import NodeId
from ltvn_viz.server.driver_seat import ClientId
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.app_state import AppState, Debugger
from ltvn_viz.session.inspection import NOTHING_SELECTED, QuestionName
from ltvn_viz.timeline.run_moment import RunMoment
from ltvn_viz.wishes import commands as c

STALE_LINK = "That answer was replaced before your click arrived. Click in the new answer."
TAKE_OVER_FIRST = "Another page drives. Take over to do this."


def handle_own(state: AppState, page: ClientId, command: c.Command, moment: RunMoment) -> None:
    """Run the command of a page without the seat in its own view; all pages show `moment`."""
    view = state.own_debuggers.get(page) or _copy_of_shared(state, page, moment)
    try:
        _carry_out(state, view, command)
    except LtvnError as error:
        view.notify(str(error))
    state.own_debuggers.move_to_end(page, last=False)
    if isinstance(command, c.ChooseQuestion) and not view.is_on:
        del state.own_debuggers[page]


def retain_own_views(state: AppState, watchers: Set[ClientId]) -> None:
    """Drop the own views of pages that were closed or now drive."""
    for page in state.own_debuggers.keys() - watchers:
        del state.own_debuggers[page]


def refresh_next_own_view(state: AppState, moment: RunMoment) -> None:
    """Refresh one own view; they take turns, so that many watchers do not slow down the loop."""
    if not isinstance(state.activity, Navigation | MapBuilding):
        state.patient_worker.go_on()
    if state.own_debuggers:
        page = next(iter(state.own_debuggers))
        state.own_debuggers[page].refresh(state, moment)
        state.own_debuggers.move_to_end(page)


def _copy_of_shared(state: AppState, page: ClientId, moment: RunMoment) -> Debugger:
    """Create an own view as a copy of the shared one."""
    view = state.new_own_debugger(page)
    shared = state.debugger.shown
    if shared.question in view.names:
        view.choose(shared.question)
    if shared.selection.edge is not None:
        view.point_at(*shared.selection.edge)
    elif shared.selection != NOTHING_SELECTED and shared.selection.node is not None:
        view.point_at(shared.selection.node)
    view.refresh(state, moment)
    state.own_debuggers[page] = view
    return view


def _carry_out(state: AppState, view: Debugger, command: c.Command | None) -> None:
    match command:
        case None:
            pass
        case c.ChooseQuestion(name):
            _choose(view, name)
        case c.PointAt(node, target):
            view.point_at(node, target)
        case c.PickNode(node):
            _pick(view, node)
        case c.SubmitText(text):
            _carry_out(state, view, view.handle_text(text))
        case c.AskQuestion(request):
            _carry_out(state, view, view.handle_request(request))
        case c.FollowLink(number):
            _carry_out(state, view, view.link(number) or state.debugger.link(number) or c.ReportError(STALE_LINK))
        case c.ReportError(text):
            view.notify(text)
        case _:
            view.notify(TAKE_OVER_FIRST)


def _choose(view: Debugger, name: str) -> None:
    known = next((each for each in view.names if each == name), None)
    if known is None:
        view.notify(f"“{name}” is only for the page that drives. Take over to ask it.")
    else:
        view.choose(known)


def _pick(view: Debugger, node: NodeId) -> None:
    if not view.is_on:
        view.choose(QuestionName.EDGE)
        view.notify(f"Node {node}: see “Why”. To send the robot there, take over first.")
    view.point_at(node)
