"""The tools of the debugger, by their names. Owns which there are."""

from collections.abc import Mapping

from ltvn_viz.why.edge import EdgeTool
from ltvn_viz.why.tool import Tool, ToolName


def tools() -> Mapping[ToolName, Tool]:
    """Return a fresh set of tools; each keeps what a person told it."""
    return {ToolName.EDGE: EdgeTool()}
