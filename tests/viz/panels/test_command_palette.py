"""What the command palette lists, and when each entry makes sense."""

import asyncio
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
import viser

from ltvn_viz.panels.command_palette import CommandPalette
from ltvn_viz.session.snapshot import BoxView, DoorView, Snapshot, WorldView
from ltvn_viz.wishes.commands import Action, Ask
from ltvn_viz.wishes.modes import Mode


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def listed(server: viser.ViserServer) -> dict[str, viser.CommandHandle]:
    return {handle.label: handle for handle in server.gui._command_handle_from_uuid.values()}


def trigger(handle: viser.CommandHandle) -> None:
    """Choose an entry, as a page does."""
    (chosen,) = handle._impl.trigger_cb
    with ThreadPoolExecutor(1) as thread:  # A browser's loop may run in this one.
        thread.submit(asyncio.run, chosen(None)).result()  # type: ignore[arg-type]


def test_actions_questions_and_recordings_are_listed_and_go_when_they_are_gone(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    palette = CommandPalette(server.gui, lambda _: None)
    palette.show(replace(snapshot, recordings={"monday.rrd": ""}))
    labels = listed(server).keys()
    assert any("monday.rrd" in label for label in labels)
    assert any("undo" in label.lower() for label in labels)
    assert all(any(question in label for label in labels) for question in snapshot.inspection.offered[1:])
    palette.show(replace(snapshot, recordings={}))
    assert not any("monday.rrd" in label for label in listed(server))


def test_all_nodes_are_one_entry_that_drives_nowhere_without_a_number(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    asked: list[Ask] = []
    CommandPalette(server.gui, asked.append).show(snapshot)
    (handle,) = (handle for label, handle in listed(server).items() if "node" in label.lower())
    assert not handle.disabled
    trigger(handle)
    assert asked == []


def test_a_door_a_box_and_the_light_are_found_by_what_is_done_with_them(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    asked: list[Ask] = []
    palette = CommandPalette(server.gui, asked.append)
    study = DoorView(0, "hall – study", 1.0, 0.0, along_x=True, width_m=0.9)
    bath = DoorView(1, "hall – bath", 2.0, 0.0, along_x=True, width_m=0.9, is_open=False)
    world = WorldView((study, bath), (BoxView(3, 1.0, 1.0),), aimed=None, light=1.0, undo="")
    palette.show(replace(snapshot, world=world))
    handles = listed(server)
    trigger(handles["Close the door hall – study"])
    trigger(handles["Open the door hall – bath"])
    trigger(handles["Take away box 3"])
    trigger(next(handle for label, handle in handles.items() if label.startswith("Light: dim")))
    assert asked == [Ask(Action.DOOR, 0), Ask(Action.DOOR, 1), Ask(Action.TAKE_BOX, 3), Ask(Action.LIGHT, 50)]
    palette.show(replace(snapshot, world=replace(world, doors=(replace(study, is_open=False), bath), boxes=())))
    assert "Open the door hall – study" in listed(server)
    assert not {"Close the door hall – study", "Take away box 3"} & listed(server).keys()


def test_a_name_stands_before_those_that_only_begin_with_it_also_when_it_comes_later(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    palette = CommandPalette(server.gui, lambda _: None)
    palette.show(replace(snapshot, recordings={"run10.rrd": "", "run12.rrd": ""}))
    palette.show(replace(snapshot, recordings={"run10.rrd": "", "run12.rrd": "", "run1.rrd": ""}))
    opening = [label for label in listed(server) if label.startswith("Open recording")]
    assert opening == [f"Open recording {name}.rrd" for name in ("run1", "run10", "run12")]


def test_what_makes_no_sense_now_is_grey_and_says_why(server: viser.ViserServer, snapshot: Snapshot) -> None:
    palette = CommandPalette(server.gui, lambda _: None)
    for mode in Mode:
        palette.show(replace(snapshot, mode=mode))
        for label, handle in listed(server).items():
            if label == "Start recording":
                assert handle.disabled == (mode not in Action.RECORD.wish.modes)
            if label.startswith("Go to node"):
                assert handle.disabled == (mode not in Action.GOAL.wish.modes)
            if handle.disabled:
                assert "Not possible now" in (handle.description or ""), label
