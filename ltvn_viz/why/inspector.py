"""Which tool is on show, what a person pointed at, and what there is to see.

Owns that state and when a tool looks again. Runs in the session's thread.
"""

import re
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.types import NodeId
from ltvn_viz.commands import Command
from ltvn_viz.why.case import Case
from ltvn_viz.why.tool import NO_VIEW, NOWHERE, Selection, Tool, ToolName, ToolView

_LINKS = 1000
"""A link is asked for by its number plus so many times the number of the view it was drawn in."""
_REMEMBERED = 100
"""So many views of the tool on show still answer to clicks on them, because a page may be behind, and answers that
change with time are replaced while a person aims.
"""
_LINK = re.compile(r'data-id="link-(\d+)"')


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """What the page shows of the debugger."""

    tool: ToolName = ToolName.NONE
    about: str = ""
    view: ToolView = NO_VIEW
    serial: int = 0
    """Counts views; part of every link."""
    selection: Selection = NOWHERE
    offered: tuple[ToolName, ...] = (ToolName.NONE,)

    @property
    def html(self) -> str:
        """The view's markup, with links that carry its number."""
        return _LINK.sub(lambda found: f'data-id="{self.serial * _LINKS + int(found[1])}"', self.view.html)


NOT_INSPECTING = Inspection()


class Inspector:
    """The debugger's state."""

    def __init__(self, tools: Mapping[ToolName, Tool]) -> None:
        """Offer these tools."""
        self._tools = tools
        self.shown = Inspection(offered=(ToolName.NONE, *(name for name in ToolName if name in tools)))
        self._key: object = None
        self._case: Case | None = None
        self._drawn: OrderedDict[int, tuple[Command, ...]] = OrderedDict()

    @property
    def is_on(self) -> bool:
        """Tell whether a tool is on show, so that clicks in the scene are meant for it."""
        return self.shown.tool is not ToolName.NONE

    def choose(self, tool: ToolName) -> None:
        """Show a tool, or none."""
        about = self._tools[tool].about if tool in self._tools else ""
        self.shown = replace(self.shown, tool=tool, about=about, view=NO_VIEW, serial=self.shown.serial + 1)
        self._drawn.clear()
        self._key = None

    def point_at(self, node: NodeId, target: NodeId | None = None) -> None:
        """Select a node, or the edge from it to `target`; the second of two joined nodes selects the edge between."""
        first = self.shown.selection.node
        if target is not None:
            selection = Selection(None, (node, target))
        elif first is not None and self._case is not None and (first, node) in self._case.graph.edges:
            selection = Selection(node, (first, node), first)
        else:
            selection = Selection(node, before=first if first != node else self.shown.selection.before)
        self.shown = replace(self.shown, selection=selection)

    def told(self, text: str) -> Command | None:
        """Hand a person's words to the tool; returns what they ask for, if anything. Raises OptionError, MapError."""
        tool = self._tools.get(self.shown.tool)
        if tool is None or self._case is None:
            raise OptionError("Choose a question first.")
        self._key = None
        return tool.told(self._case, text)

    def refresh(self, case: Case) -> None:
        """Let the tool look again if anything changed that it may show."""
        tool, self._case = self._tools.get(self.shown.tool), case
        key = self.shown.tool, self.shown.selection, case.name, case.step, case.timeline, case.view
        if tool is None or key == self._key:
            return
        self._key = key
        try:
            view = tool.look(case, self.shown.selection)
        except LtvnError as error:
            view = ToolView(f'<div class="lt">{escape(str(error))}</div>')
        if view != self.shown.view:
            self.shown = replace(self.shown, view=view, serial=self.shown.serial + 1)
            self._remember()

    def again(self) -> None:
        """Let the tool look again although nothing happened, because it knows more now."""
        self._key = None

    def link(self, number: int) -> Command | None:
        """Return what a link asks for, as it was when it was drawn; None if that was for another question, or too long
        ago.
        """
        serial, place = divmod(number, _LINKS)
        links = self._drawn.get(serial, ())
        return links[place] if place < len(links) else None

    def _remember(self) -> None:
        self._drawn[self.shown.serial] = self.shown.view.links
        if len(self._drawn) > _REMEMBERED:
            self._drawn.popitem(last=False)
