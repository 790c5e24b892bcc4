"""The “Drive” tab: record, keep, discard, and build the map."""

import viser

from ltvn_viz.keymap import Action
from ltvn_viz.modes import LIVE, Mode
from ltvn_viz.panels.markup import Markup, Press, buttons, note, numbers
from ltvn_viz.snapshot import Snapshot


class DrivePanel:
    """Recording and mapping while a person drives."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        Markup(gui, note("Drive with W A S D held; the map grows as you go. A recording holds all that happens."))
        self._recording, self._map, self._counts = Markup(gui), Markup(gui), Markup(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Enable what makes sense now and count the map."""
        live, recording = snapshot.mode in LIVE, snapshot.recording.name is not None
        self._recording.show(
            buttons(
                Press(Action.RECORD, "Record", "R", is_main=not recording, is_enabled=live and not recording),
                Press(Action.KEEP, "Keep", "N", "end and keep", is_main=True, is_enabled=live and recording),
                Press(Action.DISCARD, "Discard", "⌫", "end and set aside", is_enabled=live and recording),
            )
        )
        rebuild = "build the map anew from all images at hand"
        self._map.show(
            buttons(Press(Action.BUILD, "Build the map anew", "B", rebuild, is_enabled=snapshot.mode is Mode.TELEOP))
        )
        self._counts.show(_counts(snapshot))


def _counts(snapshot: Snapshot) -> str:
    moment = snapshot.moment
    progress = moment.progress
    return numbers(
        (f"{moment.frames:,}", "images"),
        (f"{len(moment.graph.ids):,}", "nodes"),
        (f"{len(moment.graph.p):,}", "edges"),
        (f"{progress.collisions}", "collisions"),
        (f"{progress.queries}", "tasks"),
        (f"{progress.reached}", "arrived"),
        (f"{progress.added}", "edges added"),
        (f"{progress.pruned}", "pruned"),
    )
