"""The tools of the debugger, by their names. Owns which there are."""

from collections.abc import Mapping

from ltvn_viz.why.compare import CompareTool
from ltvn_viz.why.edge import EdgeTool
from ltvn_viz.why.share import ShareTool
from ltvn_viz.why.tool import Tool, ToolName
from ltvn_viz.why.truth import TruthTool


def tools() -> Mapping[ToolName, Tool]:
    """Return a fresh set of tools; each keeps what a person told it."""
    return {
        ToolName.EDGE: EdgeTool(),
        ToolName.COMPARE: CompareTool(),
        ToolName.TRUTH: TruthTool(),
        ToolName.SHARE: ShareTool(),
    }
