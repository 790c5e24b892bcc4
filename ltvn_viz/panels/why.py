"""The “Why” tab: one tool of the debugger at a time."""

from collections.abc import Callable

import viser

from ltvn_viz.commands import ChooseTool, Command, Tell
from ltvn_viz.panels.markup import Markup, note
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.why.tool import ToolName


class WhyPanel:
    """A list of questions, the answer, and a field to type into where a tool asks for something."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        """Add the controls to the tab that is open; `send` takes commands and returns at once."""
        Markup(gui, note("Ask about the map and the run. While a question is chosen, a click on a node asks about it."))
        self._tools = gui.add_dropdown("Question", [ToolName.NONE.value])
        self._about, self._view = Markup(gui), Markup(gui)
        self._field = gui.add_text("Tell", "", visible=False)
        self._tell = gui.add_button("Tell", visible=False)
        self._offered: tuple[ToolName, ...] = ()
        self._bind(send)

    def show(self, snapshot: Snapshot) -> None:
        """Show the tool's answer."""
        inspection = snapshot.inspection
        if inspection.offered != self._offered:
            self._offered = inspection.offered
            self._tools.options = [tool.value for tool in inspection.offered]
        if self._tools.value != inspection.tool:
            self._tools.value = inspection.tool.value
        self._about.show(note(inspection.about) if inspection.about else "")
        self._view.show(inspection.html)
        asks = inspection.view.asks
        self._field.visible = self._tell.visible = bool(asks)
        if asks:
            self._field.label = asks

    def _bind(self, send: Callable[[Command], None]) -> None:
        @self._tools.on_update
        async def _(event: viser.GuiEvent) -> None:
            # The page's own updates come without a client.
            if event.client_id is not None:
                send(ChooseTool(self._tools.value))

        @self._tell.on_click
        async def _(_: viser.GuiEvent) -> None:
            send(Tell(self._field.value))
