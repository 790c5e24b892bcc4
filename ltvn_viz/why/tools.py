"""The tools of the debugger, by their names. Owns which there are."""

from collections.abc import Mapping

from ltvn_viz.why.breaks import BreakTool
from ltvn_viz.why.coach import CoachTool
from ltvn_viz.why.edge import EdgeTool
from ltvn_viz.why.hand import HandTool
from ltvn_viz.why.tool import Tool, ToolName
from ltvn_viz.why.watch import Watch
from ltvn_viz.why.what_if import WhatIfTool
from ltvn_viz.why.where import WhereTool


def tools(watch: Watch) -> Mapping[ToolName, Tool]:
    """Return a fresh set of tools; each keeps what a person told it, and breakpoints are kept in `watch`."""
    return {
        ToolName.EDGE: EdgeTool(),
        ToolName.WHAT_IF: WhatIfTool(),
        ToolName.BREAK: BreakTool(watch),
        ToolName.WHERE: WhereTool(),
        ToolName.COACH: CoachTool(),
        ToolName.HAND: HandTool(),
    }
