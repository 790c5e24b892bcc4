"""What the Rerun viewer shows of edge beliefs: a curve per edge, and a table of the edges that matter at the moment.

Every edge that is planned, driven or pruned gets a curve of its own, which begins with the belief that the edge was
made with. The table names the edges of the current plan and those that changed last. Owns which edges these are.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import rerun as rr

from ltvn_core.graph.deltas import Belief, BeliefUpdated, EdgeAdded, EdgePruned
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as ev
from ltvn_core.recording import schema
from ltvn_core.recording.map_drawing import DrawnEntity
from ltvn_core.recording.schema import RowTime

LAST_CHANGED = 8
"""Number of changed edges in the table."""
PLANNED_EDGES = 12
"""Number of edges of the plan in the table, counted from where the robot is."""


class TimedDrawing(NamedTuple):
    """A row for the viewer and its place on the timelines."""

    time: RowTime
    drawn: DrawnEntity


class _Change(NamedTuple):
    edge: EdgeKey
    before: Belief | None
    after: Belief | None
    """None for an edge that was pruned."""


class BeliefDrawing:
    """Follows the beliefs of all edges and draws those that are planned, driven or pruned."""

    def __init__(self) -> None:
        self._newest: dict[EdgeKey, tuple[RowTime, Belief]] = {}
        self._curves: set[EdgeKey] = set()
        self._plan: tuple[EdgeKey, ...] = ()
        self._changed: dict[EdgeKey, _Change] = {}
        """The edges that changed last, the newest at the end."""

    @property
    def shown_edges(self) -> Sequence[EdgeKey]:
        """The edges of the current plan and those that changed last, each once: what a glance should find."""
        return list(dict.fromkeys((*self._plan[:PLANNED_EDGES], *reversed(self._changed))))

    def draw(self, event: ev.Event, time: RowTime) -> Iterator[TimedDrawing]:
        """Yield what an event adds to curves and table."""
        match event:
            case ev.QueryStarted():
                self._plan = ()
                yield self._table(time)
            case ev.Planned(nodes=nodes):
                self._plan = tuple(pairwise(nodes))
                for edge in self._plan:
                    yield from self._begin_curve(edge)
                yield self._table(time)
            case ev.GraphChanged(delta=EdgeAdded(edge=edge)):
                key = (edge.source, edge.target)
                self._newest[key] = time, edge.belief
                if key in self._curves:  # The edge was pruned and has come back.
                    yield from _points(key, time, edge.belief)
            case ev.GraphChanged(delta=BeliefUpdated(source=source, target=target, belief=belief)):
                yield from self._change((source, target), belief, time)
            case ev.GraphChanged(delta=EdgePruned(source=source, target=target)):
                yield from self._change((source, target), None, time)
            case _:
                pass

    def _change(self, edge: EdgeKey, after: Belief | None, time: RowTime) -> Iterator[TimedDrawing]:
        yield from self._begin_curve(edge)
        before = self._newest[edge][1] if edge in self._newest else None
        if after is None:
            self._newest.pop(edge, None)
        else:
            self._newest[edge] = time, after
        self._changed.pop(edge, None)
        self._changed[edge] = _Change(edge, before, after)
        if len(self._changed) > LAST_CHANGED:
            self._changed.pop(next(iter(self._changed)))
        yield from _points(edge, time, after or Belief(0.0, math.nan, math.nan))
        yield self._table(time)

    def _begin_curve(self, edge: EdgeKey) -> Iterator[TimedDrawing]:
        """Yield the first point of an edge's curves, unless it has them already.

        Curves have no styles of their own: Rerun's table of chunks grows by a kilobyte for each.
        """
        if edge in self._curves:
            return
        self._curves.add(edge)
        if edge in self._newest:
            yield from _points(edge, *self._newest[edge])

    def _table(self, time: RowTime) -> TimedDrawing:
        planned = [f"| {_name(edge)} | {self._belief_cells(edge)} |" for edge in self._plan[:PLANNED_EDGES]]
        left_out = len(self._plan) - len(planned)
        changed = [_changed_row(change) for change in reversed(self._changed.values())]
        lines = [
            *_section("Current plan", planned),
            *([f"and {left_out} more"] if left_out else []),
            "",
            *_section("Changed last", changed),
        ]
        text = rr.TextDocument("\n".join(lines), media_type=rr.MediaType.MARKDOWN)
        return TimedDrawing(time, DrawnEntity(schema.BELIEF_TABLE, [text]))

    def _belief_cells(self, edge: EdgeKey) -> str:
        if edge not in self._newest:
            return "– | –"
        belief = self._newest[edge][1]
        return f"{belief.p:.2f} | {_length(belief)}"


def probability_entity(edge: EdgeKey) -> str:
    """Return the entity that holds p of an edge."""
    return f"{schema.PROBABILITIES}/{edge[0]}_{edge[1]}"


def length_entity(edge: EdgeKey) -> str:
    """Return the entity that holds mu and sigma of an edge."""
    return f"{schema.LENGTHS}/{edge[0]}_{edge[1]}"


def _points(edge: EdgeKey, time: RowTime, belief: Belief) -> Iterator[TimedDrawing]:
    yield TimedDrawing(time, DrawnEntity(probability_entity(edge), [rr.Scalars(belief.p)]))
    length = rr.Scalars([belief.mu, math.sqrt(belief.sigma2)])
    yield TimedDrawing(time, DrawnEntity(length_entity(edge), [length]))


def _section(title: str, rows: Sequence[str]) -> list[str]:
    return [f"**{title}**", "", *(["| edge | p | μ ± σ |", "|:--|--:|--:|", *rows] if rows else ["none"])]


def _changed_row(change: _Change) -> str:
    before = "" if change.before is None else f"{change.before.p:.2f} → "
    if change.after is None:
        return f"| {_name(change.edge)} | {before}pruned | – |"
    return f"| {_name(change.edge)} | {before}**{change.after.p:.2f}** | {_length(change.after)} |"


def _length(belief: Belief) -> str:
    return f"{belief.mu:.2f} ± {math.sqrt(belief.sigma2):.2f}"


def _name(edge: EdgeKey) -> str:
    return f"{edge[0]} → {edge[1]}"
