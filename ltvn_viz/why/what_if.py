"""What would have been otherwise: old and new plan side by side, and what other thresholds would do to the map."""

from collections.abc import Hashable
from functools import partial
from html import escape
from itertools import pairwise

from ltvn_core.analysis.change_text import change_text, parse_change
from ltvn_core.analysis.changes import (
    BeliefSet,
    Change,
    EdgeBarred,
    EdgeForced,
    ThresholdSet,
)
from ltvn_core.analysis.situation import situation_at
from ltvn_core.analysis.what_if import PricedEdge, Replanned
from ltvn_core.errors import OptionError
from ltvn_core.graph.planner import Path
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_viz import palette
from ltvn_viz.commands import PointAt, Tell
from ltvn_viz.palette import Rgb8
from ltvn_viz.why.case import Case
from ltvn_viz.why.imagining import Answer, Outcome, dry_run, imagined, rebuilt_with
from ltvn_viz.why.overlay import NOTHING, Overlay, Stroke, stroke
from ltvn_viz.why.tool import Page, Selection, ToolView
from ltvn_viz.why.weighing import weighing

_ROWS = 12
_FORGET, _ALL = "forget ", "all"


class WhatIfTool:
    """Imagines changes, and never makes them."""

    about = "Imagine an edge, a belief, the goal or a threshold to be otherwise. The map and the recording stay as is."

    def __init__(self) -> None:
        """Begin with the world as it is."""
        self._changes: dict[Hashable, Change] = {}
        self._told = 0

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Show what is imagined and what would come of it."""
        page = Page()
        self._offers(case, selection, page)
        self._imagined(page)
        overlay = NOTHING
        if self._changes:
            overlay = self._compared(case, page)
            self._rebuilt(case, page)
        return page.view(overlay, asks="What if (D_c = 1.3, R_p = 0.3, goal 120 …)")

    def told(self, case: Case, text: str) -> None:
        """Imagine one thing more, or "forget" one or "all". Raises OptionError, MapError."""
        words = " ".join(text.split())
        if words.startswith(_FORGET):
            self._forget(words.removeprefix(_FORGET))
        else:
            change = parse_change(words, case.graph, case.method.believing)
            self._changes.pop(_about(change), None)
            self._changes[_about(change)] = change
        self._told += 1

    def _forget(self, text: str) -> None:
        kept = {} if text == _ALL else {key: each for key, each in self._changes.items() if change_text(each) != text}
        if len(kept) == len(self._changes) and kept:
            raise OptionError(f"{text[:60]!r} is not imagined; {', '.join(map(change_text, kept.values()))} is.")
        self._changes = kept

    @staticmethod
    def _offers(case: Case, selection: Selection, page: Page) -> None:
        texts = [*_about_edge(case.graph, selection), *_about_node(selection)]
        if texts:
            page.html("<div>What if: " + " · ".join(page.link(text, Tell(text)) for text in texts) + "</div>")
        else:
            page.line("Click a node, then its neighbour, to imagine something about the edge between, or type below.")

    def _imagined(self, page: Page) -> None:
        for each in self._changes.values():
            text = change_text(each)
            page.html(f"<div><b>{escape(text)}</b> · {page.link('forget', Tell(_FORGET + text))}</div>")
        if len(self._changes) > 1:
            page.html(f"<div>{page.link('forget all', Tell(_FORGET + _ALL))}</div>")

    def _compared(self, case: Case, page: Page) -> Overlay:
        graph, situation, changes = case.graph, situation_at(case.timeline.events, case.step), self._all
        how = weighing(case)
        known = len(case.timeline.changes_until(case.instant)), situation.source, situation.goal
        question = "what if", case.name, self._told, *known, *situation.failures.items()
        plan = partial(imagined, graph, situation, case.method, changes, how.weights)
        outcome: Outcome | None = case.later(question, plan)
        if outcome is None:
            page.line("Planning both ways …")
            return NOTHING
        if isinstance(outcome, str):
            page.line(outcome)
            return NOTHING
        if how.note:
            page.line(how.note)
        _say(outcome, page)
        return _overlay(case, outcome.plans)

    @property
    def _all(self) -> tuple[Change, ...]:
        return tuple(self._changes.values())

    def _rebuilt(self, case: Case, page: Page) -> None:
        changed = rebuilt_with(case.method, self._all)
        if changed is None:
            return
        if case.mapping is None:
            page.line("How many nodes a rebuild would make is counted live only, where all images are at hand.")
            return
        question = "dry run", self._told
        counted = case.later(question, dry_run(case, changed))
        if counted is None:
            page.line("Building two maps to compare, without using either: takes tens of seconds, and tasks wait.")
        else:
            page.html(f"<div>Rebuilt so: <b>{escape(counted)}</b></div>")


def _about(change: Change) -> Hashable:
    """Return what a change is about; a later one about the same takes its place."""
    match change:
        case EdgeForced(source, target) | EdgeBarred(source, target):
            return "there", source, target
        case BeliefSet(source, target, p):
            return "mu" if p is None else "p", source, target
        case ThresholdSet(threshold):
            return threshold
    return type(change)


def _about_edge(graph: TopologicalGraph, selection: Selection) -> tuple[str, ...]:
    edge = selection.edge or selection.pair
    if edge is None:
        return ()
    name = f"{edge[0]}->{edge[1]}"
    if edge not in graph.edges:
        return (f"with {name}",)
    return f"without {name}", f"p({name}) = 0.1", f"p({name}) = 0.9"


def _about_node(selection: Selection) -> tuple[str, ...]:
    return () if selection.node is None else (f"goal {selection.node}", f"from {selection.node}")


def _say(answer: Answer, page: Page) -> None:
    plans = answer.plans
    if answer.pruned is not None:
        page.line(answer.pruned.sentence)
    for note in plans.notes:
        page.line(note)
    asked = answer.asked
    if asked.source is not None and asked.goal is not None:
        page.html(f"<div>From {asked.source} to {asked.goal}: <b>{escape(plans.sentence)}</b></div>")
        _table(plans, page)


def _table(plans: Replanned, page: Page) -> None:
    rows = [_row(page, "old", each) for each in plans.old_edges if each.edge in plans.left]
    rows += [_row(page, "new", each) for each in plans.new_edges if each.edge in plans.joined]
    if not rows:
        known = {each.edge: each for each in plans.old_edges}
        rows = [_row(page, "now", each) for each in plans.new_edges if known.get(each.edge) != each]
    if rows:
        page.table(("plan", "edge", "length", "doubt", "failed"), rows[:_ROWS])


def _row(page: Page, plan: str, priced: PricedEdge) -> tuple[str, ...]:
    source, target = priced.edge
    numbers = (f"{each:.2f}" for each in (priced.mu, priced.doubt, priced.penalty))
    return plan, page.link(f"{source} → {target}", PointAt(source, target)), *numbers


def _overlay(case: Case, plans: Replanned) -> Overlay:
    strokes = (*_strokes(case, plans.old, palette.PLAN), *_strokes(case, plans.new, palette.CAME, plans.joined))
    return Overlay(strokes) if strokes else NOTHING


def _strokes(case: Case, path: Path, colour: Rgb8, only: tuple[EdgeKey, ...] | None = None) -> tuple[Stroke, ...]:
    keys = [key for key in pairwise(path.nodes) if only is None or key in only]
    ends = [(case.pose(source), case.pose(target)) for source, target in keys]
    return tuple(stroke(start, end, colour) for start, end in ends if start is not None and end is not None)
