"""The edge microscope: both images, the predicted waypoint, what was believed when, and every attempt."""

from html import escape

import numpy as np

from ltvn_core.analysis.edges import AttemptRow, EdgeStory, edge_story
from ltvn_core.analysis.records import Instant
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose
from ltvn_core.types import Waypoint
from ltvn_viz import palette
from ltvn_viz.commands import PointAt
from ltvn_viz.why.case import Case
from ltvn_viz.why.overlay import NOTHING, Overlay, stroke
from ltvn_viz.why.pictures import curve, image
from ltvn_viz.why.tool import Page, Selection, ToolView

_ATTEMPTS = 40


class EdgeTool:
    """Shows one edge."""

    about = "Both images of an edge, what was believed of it when, and every attempt. Click a node, then its neighbour."

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show the edge that was pointed at, or those of the node."""
        page = Page()
        if selection.edge is not None:
            return self._edge(case, edge_story(case.timeline, *selection.edge), page)
        if selection.node is None:
            page.line("Click a node in the scene.")
            return page.view()
        return self._edges_of(case, selection.node, page)

    def told(self, case: Case, text: str) -> None:
        """Take nothing in."""
        raise OptionError("Nothing is asked here; click a node in the scene.")

    def _edges_of(self, case: Case, node: int, page: Page) -> ToolView:
        page.line(f"Node {node}. Choose one of its edges:")
        rows = []
        for target in sorted(case.graph.successors(node)) if node in case.graph.nodes else ():
            belief = case.graph.edges[node, target].belief
            rows.append((page.link(f"{node} → {target}", PointAt(node, target)), f"{belief.p:.2f}", f"{belief.mu:.2f}"))
        page.table(("edge", "p", "length"), rows)
        return page.view(Overlay(nodes={node: palette.SOURCE}))

    def _edge(self, case: Case, story: EdgeStory, page: Page) -> ToolView:
        source, target = story.source, story.target
        back = page.link("the way back", PointAt(target, source))
        page.html(f"<div>Edge <b>{source} → {target}</b> · {back}</div>")
        if not story.lives:
            page.line("The map never had this edge.")
            return page.view(self._overlay(case, story))
        life = story.lives[-1]
        waypoint = np.array(life.waypoint)
        pair = image(case.picture(source), f"from {source}", waypoint) + image(case.picture(target), f"to {target}")
        page.html(f'<div class="lt-pair">{pair}</div>')
        page.line(f"Predicted: {_where(waypoint)}; r {_number(life.r_at_birth)}.")
        self._beliefs(case, story, page)
        self._attempts(case, story, page)
        return page.view(self._overlay(case, story))

    def _beliefs(self, case: Case, story: EdgeStory, page: Page) -> None:
        history = [each for life in story.lives for each in life.history]
        now = history[-1].belief
        born = story.lives[-1].born
        page.html(
            f"<div>p <b>{now.p:.2f}</b> · length <b>{now.mu:.2f}</b> ± {now.sigma2**0.5:.2f} · "
            f"{'in the map since' if story.alive else 'came at'} {self._jump(case, page, born)} · "
            f"in {len(story.planned)} plans</div>"
        )
        points = [(case.seconds(each.instant), each.belief.p) for each in history]
        page.html(curve(points, lines=((case.method.believing.prune_below, "R_p"),), colour=palette.SOURCE))
        if (end := story.lives[-1].end) is not None:
            page.html(f"<div>It left the map at {self._jump(case, page, end.instant)}, {end.cause.value}.</div>")

    def _attempts(self, case: Case, story: EdgeStory, page: Page) -> None:
        if not story.attempts:
            page.line("Nobody drove it yet.")
            return
        rows = [self._attempt(case, each, page) for each in story.attempts[-_ATTEMPTS:]]
        page.table(("when", "from", "result", "d", "r"), rows)

    def _attempt(self, case: Case, row: AttemptRow, page: Page) -> tuple[str, ...]:
        at = "–" if row.localised is None or row.localised.node is None else str(row.localised.node)
        result = "cut" if row.succeeded is None else "success" if row.succeeded else f"failed ({row.end})"
        numbers = map(_number, (row.distance, row.reachability))
        return self._jump(case, page, row.begin), at, f'<span title="{escape(row.reason)}">{result}</span>', *numbers

    @staticmethod
    def _jump(case: Case, page: Page, instant: Instant) -> str:
        return page.jump(case.seconds(instant))

    @staticmethod
    def _overlay(case: Case, story: EdgeStory) -> Overlay:
        start, end = case.pose(story.source), case.pose(story.target)
        if start is None or end is None:
            return NOTHING
        ghost = tuple(compose(start, np.array(story.lives[-1].waypoint)).tolist()) if story.lives else None
        return Overlay(
            strokes=(stroke(start, end, palette.TARGET),),
            nodes={story.source: palette.SOURCE, story.target: palette.TARGET},
            ghosts=() if ghost is None else (ghost,),
        )


def _where(waypoint: Waypoint) -> str:
    dx, dy, turn = float(waypoint[0]), float(waypoint[1]), float(np.degrees(waypoint[2]))
    along = f"{abs(dx):.2f} m {'ahead' if dx >= 0 else 'back'}, {abs(dy):.2f} m to the {'left' if dy >= 0 else 'right'}"
    return f"{along}, turned {abs(turn):.0f}° {'left' if turn >= 0 else 'right'}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
