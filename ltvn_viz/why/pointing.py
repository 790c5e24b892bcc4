"""What a tool that shows many edges does with the one that a person pointed at."""

from ltvn_core.types import NodeId
from ltvn_viz import palette
from ltvn_viz.commands import ChooseTool
from ltvn_viz.palette import Rgb8
from ltvn_viz.why.tool import Page, Selection, ToolName


def pointed(page: Page, selection: Selection) -> dict[NodeId, Rgb8]:
    """Add a link to the tool for the edge that is selected, and return how its ends are coloured."""
    if selection.edge is None:
        return {}
    source, target = selection.edge
    more = page.link("its pictures and attempts", ChooseTool(ToolName.EDGE))
    page.html(f"<div>Edge <b>{source} → {target}</b>: {more}</div>")
    return {source: palette.SOURCE, target: palette.TARGET}
