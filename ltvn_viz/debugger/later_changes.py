"""What is still to come of an edge where a run goes on after the moment on show: one line, with the way there."""

from ltvn_core.analysis.edge_history import EdgeHistory, edge_history
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder


def add_later_changes(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    """Say when an edge, told up to the moment, leaves the map or comes in later; nothing where neither happens."""
    later = edge_history(context.timeline, story.source, story.target)
    if story.alive and later.lifetimes and (end := later.lifetimes[len(story.lifetimes) - 1].end) is not None:
        builder.add_html(f"<div>Later it leaves the map, at {builder.time_link(context.seconds(end.instant))}.</div>")
    elif not story.alive and len(later.lifetimes) > len(story.lifetimes):
        added_at = later.lifetimes[len(story.lifetimes)].added_at
        builder.add_html(
            f"<div>Later it comes {'back ' * bool(story.lifetimes)}in, at "
            f"{builder.time_link(context.seconds(added_at))}.</div>"
        )
