"""What is open or closed in one map and not in another, and what is different in their worlds: words and colours.

Owns how a comparison shows these. What differs is computed in `compared_map`.
"""

from collections.abc import Sequence

from ltvn_core import palette
from ltvn_core.analysis.edge_presence_history import PresenceChange, PresenceState, presence_state
from ltvn_core.analysis.world_clock import clock_text
from ltvn_core.worlds.world_change import TimePassed, change_text
from ltvn_viz.debugger.compared_map import MapComparison
from ltvn_viz.debugger.question import AnswerBuilder
from ltvn_viz.debugger.svg_figures import legend_item
from ltvn_viz.session.commands import PointAt
from ltvn_viz.session.overlay import Stroke, stroke

_ROWS = 12
CLOSED, RETURNED = palette.TARGET, palette.SOURCE


def add_presence_changes(found: MapComparison, builder: AnswerBuilder) -> None:
    """Say which edges are taken for closed here and were not there, and which have come back."""
    if not (found.here.graph.presence or found.there.graph.presence):
        return
    closed, returned = closed_since(found.presence), returned_since(found.presence)
    builder.add_text(f"It is {clock_text(found.here.world_s)} here, and {clock_text(found.there.world_s)} there.")
    builder.add_html(
        f"<div>{legend_item(CLOSED, f'closed here, not there: {len(closed)}')}"
        f"{legend_item(RETURNED, f'open again here: {len(returned)}')}</div>"
    )
    rows = [
        (
            builder.link(f"{each.edge[0]} → {each.edge[1]}", PointAt(*each.edge)),
            f"{each.before:.2f} {presence_state(each.before)}",
            f"{each.now:.2f} {presence_state(each.now)}",
        )
        for each in found.presence[:_ROWS]
    ]
    if rows:
        builder.add_table(("edge", "p open there", "p open here"), rows)
    if len(found.presence) > _ROWS:
        builder.add_text(f"… and {len(found.presence) - _ROWS} more.")


def add_world_changes(found: MapComparison, builder: AnswerBuilder) -> None:
    """In simulation, say what is different in the world itself."""
    texts = [change_text(each) for each in found.world if not isinstance(each, TimePassed)]
    if texts:
        more = f", and {len(texts) - _ROWS} more" if len(texts) > _ROWS else ""
        builder.add_text(f"In the world: {', '.join(texts[:_ROWS])}{more}.")


def presence_strokes(found: MapComparison) -> tuple[Stroke, ...]:
    """Return a line for each edge that is closed, or has come back."""
    poses = found.here.poses
    coloured = [
        *((each.edge, CLOSED) for each in closed_since(found.presence)),
        *((each.edge, RETURNED) for each in returned_since(found.presence)),
    ]
    known = ((edge, colour) for edge, colour in coloured if edge[0] in poses and edge[1] in poses)
    return tuple(stroke(poses[edge[0]], poses[edge[1]], colour) for edge, colour in known)


def closed_since(changes: Sequence[PresenceChange]) -> Sequence[PresenceChange]:
    """Return the edges that were taken for open and are no longer."""
    return [each for each in changes if presence_state(each.before) is PresenceState.OPEN]


def returned_since(changes: Sequence[PresenceChange]) -> Sequence[PresenceChange]:
    """Return the edges that are taken for open and were not."""
    return [each for each in changes if presence_state(each.now) is PresenceState.OPEN]
