"""The tools of the debugger, by their names. Owns which there are."""

from collections.abc import Mapping

from ltvn_viz.why.blame import BlameTool
from ltvn_viz.why.breaks import BreakTool
from ltvn_viz.why.coach import CoachTool
from ltvn_viz.why.compare import CompareTool
from ltvn_viz.why.edge import EdgeTool
from ltvn_viz.why.failures import FailuresTool
from ltvn_viz.why.hand import HandTool
from ltvn_viz.why.happened import HappenedTool
from ltvn_viz.why.share import ShareTool
from ltvn_viz.why.tool import Tool, ToolName
from ltvn_viz.why.truth import TruthTool
from ltvn_viz.why.watch import Watch
from ltvn_viz.why.what_if import WhatIfTool
from ltvn_viz.why.where import WhereTool


def tools(watch: Watch) -> Mapping[ToolName, Tool]:
    """Return a fresh set of tools; each keeps what a person told it, and breakpoints are kept in `watch`."""
    return {
        ToolName.EDGE: EdgeTool(),
        ToolName.BLAME: BlameTool(),
        ToolName.TIME: HappenedTool(),
        ToolName.WHAT_IF: WhatIfTool(),
        ToolName.BREAK: BreakTool(watch),
        ToolName.WHERE: WhereTool(),
        ToolName.COACH: CoachTool(),
        ToolName.FAILURES: FailuresTool(),
        ToolName.COMPARE: CompareTool(),
        ToolName.TRUTH: TruthTool(),
        ToolName.HAND: HandTool(),
        ToolName.SHARE: ShareTool(),
    }
