"""Add a question of your own to the debugger in the page: which edges does the robot believe in least?

Run this file to see it: open the link, choose the tab "Why?" and then "Doubtful edges?". To have it always, name the
class in your package's entry points `ltvn.questions`.
"""

import sys
from pathlib import Path
from typing import Never

from ltvn_core import palette
from ltvn_viz.app import AppOptions, run_app
from ltvn_viz.debugger.question import (
    AnswerBuilder,
    DebugContext,
    Overlay,
    Question,
    QuestionAnswer,
    Selection,
    edge_link,
    stroke,
)

RECORDINGS = Path(__file__).parents[1] / "recordings"
SHOWN = 5


class DoubtfulEdgesQuestion(Question[Never]):
    """Lists the edges with the lowest probability, and draws them over the map."""

    name = "Doubtful edges?"
    word = "doubtful-edges"
    about = "The edges that the robot believes in least, at this moment of the recording."

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return a line with a link for each edge, and a stroke along it in the scene."""
        edges = sorted(context.graph.edges.values(), key=lambda edge: edge.belief.p)[:SHOWN]
        builder = AnswerBuilder()
        strokes = []
        for edge in edges:
            link = edge_link(edge.source, edge.target)
            builder.add_line(link, f": p = {edge.belief.p:.2f} after {edge.attempts} attempts")
            start, end = context.pose(edge.source), context.pose(edge.target)
            if start is not None and end is not None:
                strokes.append(stroke(start, end, palette.EDGE_REMOVED))
        return builder.build(Overlay(strokes=tuple(strokes)))


def main(recordings: Path = RECORDINGS) -> None:
    """Open the page on the demo recording, with the question; Ctrl-C ends it."""
    options = AppOptions(recordings=recordings, replay="demo-fault.rrd", questions=(DoubtfulEdgesQuestion,))
    run_app(options, say=print)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else RECORDINGS)
