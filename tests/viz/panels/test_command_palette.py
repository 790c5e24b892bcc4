"""What the command palette lists, and when each entry makes sense."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
import viser

from ltvn_viz.panels.command_palette import CommandPalette
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def listed(server: viser.ViserServer) -> dict[str, viser.CommandHandle]:
    return {handle.label: handle for handle in server.gui._command_handle_from_uuid.values()}


def test_actions_questions_recordings_and_places_are_listed_and_go_when_they_are_gone(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    palette = CommandPalette(server.gui, lambda action, value: None)
    palette.show(replace(snapshot, recordings={"monday.rrd": ""}))
    nodes = [int(node) for node in snapshot.moment.graph.ids]
    labels = listed(server).keys()
    assert any("monday.rrd" in label for label in labels)
    assert any("undo" in label.lower() for label in labels)
    assert all(f"Go to node {node}" in labels for node in nodes)
    assert all(any(question in label for label in labels) for question in snapshot.inspection.offered[1:])

    palette.show(replace(snapshot, recordings={}))
    assert not any("monday.rrd" in label for label in listed(server))


def test_what_makes_no_sense_now_is_grey(server: viser.ViserServer, snapshot: Snapshot) -> None:
    palette = CommandPalette(server.gui, lambda action, value: None)
    for mode in Mode:
        palette.show(replace(snapshot, mode=mode))
        for label, handle in listed(server).items():
            if label == "Start recording":
                assert handle.disabled == (mode not in c.StartRecording.modes)
            if label.startswith("Go to node"):
                assert handle.disabled == (mode not in c.NavigateTo.modes)
