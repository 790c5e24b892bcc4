"""What a tool that shows many edges does with the one that a person pointed at."""

from ltvn_core import palette
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.question import AnswerBuilder, QuestionName, Selection
from ltvn_viz.session.commands import ChooseQuestion


def add_selected_edge(builder: AnswerBuilder, selection: Selection) -> dict[NodeId, Rgb8]:
    """Add a link to the tool for the edge that is selected, and return how its ends are coloured."""
    if selection.edge is None:
        return {}
    source, target = selection.edge
    more = builder.link("its pictures and attempts", ChooseQuestion(QuestionName.EDGE))
    builder.add_html(f"<div>Edge <b>{source} → {target}</b>: {more}</div>")
    return {source: palette.SOURCE, target: palette.TARGET}
