"""The tools of the debugger, by their names. Owns which there are."""

from collections.abc import Mapping

from ltvn_viz.why.blame import BlameTool
from ltvn_viz.why.edge import EdgeTool
from ltvn_viz.why.failures import FailuresTool
from ltvn_viz.why.happened import HappenedTool
from ltvn_viz.why.tool import Tool, ToolName


def tools() -> Mapping[ToolName, Tool]:
    """Return a fresh set of tools; each keeps what a person told it."""
    return {
        ToolName.EDGE: EdgeTool(),
        ToolName.BLAME: BlameTool(),
        ToolName.TIME: HappenedTool(),
        ToolName.FAILURES: FailuresTool(),
    }
