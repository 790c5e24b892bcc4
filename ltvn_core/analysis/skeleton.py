"""A test to begin with, written from a moment that a person found interesting.

Owns the text. What it asserts is what happened, right or wrong: whoever saves it says what should have happened.
"""

import textwrap
from collections.abc import Sequence

from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned, NodeAdded, NodeDropped
from ltvn_core.nav.events import GraphChanged, LegEnded, Planned, QueryEnded, Stamped
from ltvn_core.types import NodeId

_HEAD = '''"""What happened in {about}.

Each test says what did happen. Change what should have happened differently, and keep the rest.
"""

from pathlib import Path

import pytest

from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.nav.events import {names}
from ltvn_core.recording.reader import Recording

RECORDING = Path(__file__).parent / "{file}"


@pytest.fixture(scope="module")
def moment() -> Recording:
    return Recording.open(RECORDING)
'''

_LEGS = """

@pytest.mark.parametrize(
    ("attempt", "source", "target", "end", "succeeded"),
    [
{rows}
    ],
)
def test_legs_end_as_they_did(
    moment: Recording, attempt: int, source: int | None, target: int, end: LegEnd, succeeded: bool
) -> None:
    legs = {{stamped.event.attempt: stamped.event for stamped in moment.events if isinstance(stamped.event, LegEnded)}}
    leg = legs[attempt]
    assert (leg.source, leg.target, leg.end, leg.succeeded) == (source, target, end, succeeded)
"""

_PLANS = """

def test_it_planned_as_it_did(moment: Recording) -> None:
    plans = [stamped.event.nodes for stamped in moment.events if isinstance(stamped.event, Planned)]
    assert len(plans) == {count}
    assert plans[0] == (
{first}
    )
    assert plans[-1] == (
{last}
    )
"""

_OUTCOME = """

def test_query_{query}_ended(moment: Recording) -> None:
    ends = {{stamped.event.query: stamped.event for stamped in moment.events if isinstance(stamped.event, QueryEnded)}}
    assert ends[{query}].outcome is Outcome.{outcome}
    assert ends[{query}].collisions == {collisions}
"""

_MAP = """

def test_the_map_afterwards(moment: Recording) -> None:
    graph: TopologicalGraph = moment.final_graph()
{rows}
"""


def skeleton(events: Sequence[Stamped], *, file: str, about: str) -> str:
    """Return a pytest module that opens the recording `file`, as seen from its own folder, and asserts what it tells.

    `events` are those of the moment, without what made the map at its start; `about` names the moment in a few words.
    """
    happened = [stamped.event for stamped in events]
    legs = [event for event in happened if isinstance(event, LegEnded)]
    plans = [event.nodes for event in happened if isinstance(event, Planned)]
    ends = [event for event in happened if isinstance(event, QueryEnded)]
    parts = [_LEGS.format(rows="\n".join(map(_leg, legs)))] if legs else []
    if plans:
        parts.append(_PLANS.format(count=len(plans), first=_wrapped(plans[0]), last=_wrapped(plans[-1])))
    parts += [_OUTCOME.format(query=e.query, outcome=e.outcome.name, collisions=e.collisions) for e in ends]
    changes = _changes(events)
    if changes or not parts:
        parts.append(_MAP.format(rows="\n".join(f"    {row}" for row in changes or ["assert graph.nodes"])))
    return _head(file, about, legs=bool(legs), plans=bool(plans), ends=bool(ends)) + "".join(parts)


def _head(file: str, about: str, *, legs: bool, plans: bool, ends: bool) -> str:
    names = ["LegEnd", "LegEnded"] * legs + ["Outcome"] * ends + ["Planned"] * plans + ["QueryEnded"] * ends
    head = _HEAD.format(about=about, names=", ".join(names), file=file)
    return head if names else head.replace("from ltvn_core.nav.events import \n", "")


def _leg(leg: LegEnded) -> str:
    ends = f"{leg.attempt}, {leg.source}, {leg.target}, LegEnd.{leg.end.name}, {leg.succeeded}"
    return f"        ({ends}),  # {leg.reason}"


def _wrapped(nodes: Sequence[NodeId]) -> str:
    text = "".join(f"{node}, " for node in nodes)
    return textwrap.fill(text, 118, initial_indent=" " * 8, subsequent_indent=" " * 8)


def _changes(events: Sequence[Stamped]) -> list[str]:
    """Return an assertion for all that the moment changed for good, in the order in which it happened last."""
    rows: dict[object, str] = {}
    for stamped in events:
        if not isinstance(stamped.event, GraphChanged):
            continue
        match stamped.event.delta:
            case NodeAdded(node=node):
                rows[node.id] = f"assert {node.id} in graph.nodes"
            case NodeDropped(node=node):
                # Its edges went with it.
                rows = {key: row for key, row in rows.items() if not (isinstance(key, tuple) and node in key)}
                rows[node] = f"assert {node} not in graph.nodes"
            case EdgeAdded(edge=edge):
                rows[edge.source, edge.target] = f"assert ({edge.source}, {edge.target}) in graph.edges"
            case EdgePruned(source=source, target=target):
                rows[source, target] = f"assert ({source}, {target}) not in graph.edges"
            case BeliefUpdated(source=source, target=target, belief=belief):
                now = f"graph.edges[{source}, {target}].belief.p"
                rows[source, target] = f"assert {now} == pytest.approx({belief.p:.6g}, abs=1e-6)"
    return list(rows.values())
