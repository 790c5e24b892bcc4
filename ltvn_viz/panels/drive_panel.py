"""The “Drive” tab: record, keep, discard, and build the map."""

import viser

from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, number_grid, with_keys
from ltvn_viz.server.keymap import Action
from ltvn_viz.session.modes import LIVE, Mode
from ltvn_viz.session.snapshot import Snapshot


class DrivePanel:
    """Recording and mapping while a person drives."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        about = with_keys("Drive with W A S D held; the map grows as you go. A recording holds all that happens.")
        HtmlBlock(gui, f'<div class="lt lt-note">{about}</div>')
        self.recording, self.map, self.counts = HtmlBlock(gui), HtmlBlock(gui), HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Enable what makes sense now and count the map."""
        live, recording = snapshot.mode in LIVE, snapshot.recording.name is not None
        self.recording.show(
            button_row(
                ActionButton(Action.RECORD, "Record", "R", is_main=not recording, is_enabled=live and not recording),
                ActionButton(Action.KEEP, "Keep", "N", "end and keep", is_main=True, is_enabled=live and recording),
                ActionButton(Action.DISCARD, "Discard", "⌫", "end and set aside", is_enabled=live and recording),
            )
        )
        recorded = snapshot.mode is Mode.REPLAY
        ready = snapshot.mode is Mode.TELEOP or (recorded and not snapshot.is_making)
        whence = "all images of this recording, into a new file" if recorded else "all images at hand"
        rebuild = f"build the map anew from {whence}"
        build = ActionButton(Action.BUILD, "Build the map anew", "B", rebuild, is_enabled=ready)
        cancel = ActionButton(Action.CANCEL, "Cancel", "Esc", "stop building; the old map stays")
        self.map.show(button_row(build, cancel) if snapshot.mode is Mode.BUILDING else button_row(build))
        self.counts.show(_counts(snapshot))


def _counts(snapshot: Snapshot) -> str:
    moment = snapshot.moment
    progress = moment.progress
    return number_grid(
        (f"{moment.frames:,}", "images of this drive"),
        (f"{len(moment.graph.ids):,}", "nodes"),
        (f"{len(moment.graph.p):,}", "edges"),
        (f"{progress.collisions}", "collisions"),
        (f"{progress.queries}", "queries"),
        (f"{progress.reached}", "arrived"),
        (f"{progress.added:,}", "edges came in"),
        (f"{progress.pruned:,}", "edges pruned"),
    )
