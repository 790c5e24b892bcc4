"""The part of the “World” tab for floors: choose a floor, and align the floor plan with the map by clicks."""

from html import escape

import viser

from ltvn_core.data.importing.floor_plan_alignment import LEAST_PAIRS
from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, copy_button, note, warning
from ltvn_viz.session.floor_plan_clicks import is_doubtful
from ltvn_viz.session.snapshot import FloorChoice, FloorPlanView, Snapshot
from ltvn_viz.wishes.wish_table import Action


class FloorPlanPanel:
    """Controls to choose a floor, if there are several, and to align the floor plan, if there is one."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        self.floors = HtmlBlock(gui)
        self.about = HtmlBlock(gui)
        self.buttons = HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Show the controls that are possible now."""
        self.floors.show("" if snapshot.floor is None else _floors(snapshot.floor))
        view = snapshot.floor_plan
        if view is None:
            return
        title = '<div class="lt"><h2>Floor plan</h2></div>'
        self.about.show(title + (_fit(view) if view.is_aligning else _in_use(view)))
        self.buttons.show(button_row(*(_steps(view) if view.is_aligning else (_START,))))


def _floors(shown: FloorChoice) -> str:
    title = f'<div class="lt"><h2>Floor {shown.floor + 1} of {shown.floors}</h2></div>'
    each = (
        ActionButton(Action.SHOW_FLOOR, f"Floor {floor + 1}", is_enabled=floor != shown.floor, target=floor)
        for floor in range(shown.floors)
    )
    robots = ActionButton(Action.SHOW_FLOOR, "Follow the robot", is_enabled=not shown.follows_robot)
    buttons = title + button_row(*each, robots)
    if shown.robots is None or shown.robots == shown.floor:
        return buttons
    return buttons + note(f"The robot is on floor {shown.robots + 1}.")


_START = ActionButton(Action.ALIGN_PLAN, "Align by clicks")


def _steps(view: FloorPlanView) -> tuple[ActionButton, ...]:
    return (
        ActionButton(Action.USE_ALIGNMENT, "Use it", is_main=True, is_enabled=view.pairs >= LEAST_PAIRS),
        ActionButton(Action.UNDO_PLAN_CLICK, "Undo last", is_enabled=bool(view.marks)),
        ActionButton(Action.ALIGN_PLAN, "Cancel", hint="leave the plan as it was before"),
    )


def _fit(view: FloorPlanView) -> str:
    """Return a text about how well the pairs fit; the page's hint tells what to click next."""
    if view.error_m is None:
        return note(
            f"Pairs of a node and its place: {view.pairs}. Two are enough, a third shows whether they are right."
        )
    if is_doubtful(view):
        return warning(
            f"The {view.pairs} pairs disagree by {view.error_m:.2f} m: one is wrong, or odometry drifted far."
        )
    return note(f"The {view.pairs} pairs fit to {view.error_m:.2f} m.")


def _in_use(view: FloorPlanView) -> str:
    if not view.align:
        return note("Click nodes of the map and their places on the plan, and the plan moves under the map.")
    return (
        f'<div class="lt lt-note">Aligned by your clicks. The same next time: <code>{escape(view.align)}</code> '
        f"{copy_button('copy it', view.align)}</div>"
    )
