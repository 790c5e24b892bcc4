"""The “World” tab: doors, boxes and light of the simulated world, changed while the robot drives."""

import viser

from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, lines, note
from ltvn_viz.session.snapshot import DoorView, Snapshot, WorldView
from ltvn_viz.wishes.modes import Mode
from ltvn_viz.wishes.wish_table import Action

LIGHTS = (("Plain", 100), ("Dim", 50), ("Dark", 20))
"""Names of the settings of light, each with its brightness in percent."""


class WorldPanel:
    """Controls to change the simulated world."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        self.watch = HtmlBlock(gui)
        self.story = HtmlBlock(gui)
        self.about = HtmlBlock(gui)
        self.doors = HtmlBlock(gui)
        self.boxes = HtmlBlock(gui)
        self.light = HtmlBlock(gui)
        self.undo = HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Show the possible changes of the world."""
        world = snapshot.world
        if world is None:
            self.about.show(note("Only the simulated world of the live robot can be changed."))
            for block in (self.doors, self.boxes, self.light, self.undo, self.watch, self.story):
                block.show("")
            return
        self.about.show(note(_about(world)))
        self.doors.show(_doors(world.doors, snapshot.mode))
        self.boxes.show(_boxes(world, snapshot.mode))
        self.light.show(_light(world, snapshot.mode))
        label = f"Undo: {world.undo}" if world.undo else ""
        undo = ActionButton(Action.UNDO_CHANGE, label, is_enabled=bool(world.undo))
        self.undo.show(button_row(undo, mode=snapshot.mode))
        can_watch = not snapshot.no_story and not snapshot.story_goes_on
        watch = ActionButton(Action.WATCH_IT_LEARN, is_main=True, is_enabled=can_watch, hint=snapshot.no_story)
        self.watch.show(button_row(watch, mode=snapshot.mode) + (note(snapshot.no_story) if snapshot.no_story else ""))
        self.story.show(lines(*(f"{number}. {text}" for number, text in enumerate(snapshot.story, 1))))


def _about(world: WorldView) -> str:
    if not world.doors:
        return "Change the world while the robot drives. This scene has no doors that can be closed."
    return "Change the world while the robot drives. Click a door on the map, or here."


def _doors(doors: tuple[DoorView, ...], mode: Mode) -> str:
    if not doors:
        return ""
    return button_row(
        *(
            ActionButton(
                Action.DOOR,
                f"{each.label}: {'open' if each.is_open else 'closed'}",
                hint=f"{'close' if each.is_open else 'open'} this door",
                is_main=not each.is_open,
                target=each.door,
            )
            for each in doors
        ),
        mode=mode,
    )


def _boxes(world: WorldView, mode: Mode) -> str:
    new = ActionButton(Action.AIM_BOX, is_main=world.aimed == 0, target=0)
    rows = [button_row(new, ActionButton(Action.PUT_BOX), mode=mode)]
    rows += [_box(each.number, world.aimed, mode) for each in world.boxes]
    if world.aimed is not None:
        rows.append(note("Click the floor, coloured now, where the box shall be. Press again to cancel."))
    return "".join(rows)


def _box(number: int, aimed: int | None, mode: Mode) -> str:
    move = ActionButton(Action.AIM_BOX, f"Move box {number}", is_main=aimed == number, target=number)
    take = ActionButton(Action.TAKE_BOX, f"Take away box {number}", target=number)
    return button_row(move, take, mode=mode)


def _light(world: WorldView, mode: Mode) -> str:
    now = round(100 * world.light)
    return button_row(
        *(
            ActionButton(Action.LIGHT, name, hint=f"light at {percent} %", is_main=percent == now, target=percent)
            for name, percent in LIGHTS
        ),
        mode=mode,
    )
