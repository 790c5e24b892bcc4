"""A test to begin with, written from a moment that a person found interesting.

Owns the text. What it asserts is what happened, right or wrong: whoever saves it says what should have happened.
"""

from collections.abc import Sequence

from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned, NodeAdded, NodeDropped
from ltvn_core.nav.events import GraphChanged, LegEnded, Planned, QueryEnded, Stamped
from ltvn_core.recording.excerpt import Excerpt

_HEAD = '''"""What happened from {from_s:.1f} s to {to_s:.1f} s of {origin}.

Each test says what did happen. Change what should have happened differently, and keep the rest.
"""

from pathlib import Path

import pytest

from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.nav.events import {names}
from ltvn_core.recording.reader import Recording

RECORDING = Path(__file__).parent / {file!r}


@pytest.fixture(scope="module")
def moment() -> Recording:
    return Recording.open(RECORDING)
'''

_LEG = """

def test_leg_{attempt}_from_{start}_to_node_{target}_{verdict}(moment: Recording) -> None:
    legs = {{stamped.event.attempt: stamped.event for stamped in moment.events if isinstance(stamped.event, LegEnded)}}
    leg = legs[{attempt}]
    assert (leg.source, leg.target) == ({source}, {target})
    assert leg.end is LegEnd.{end}  # {reason}
    assert leg.succeeded is {succeeded}
"""

_PLANS = """

def test_the_paths_taken(moment: Recording) -> None:
    plans = [stamped.event.nodes for stamped in moment.events if isinstance(stamped.event, Planned)]
    assert plans == [
{rows}
    ]
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


def skeleton(excerpt: Excerpt, events: Sequence[Stamped]) -> str:
    """Return a pytest module that lies beside the excerpt and asserts what its events (of the moment) say."""
    happened = [stamped.event for stamped in events]
    legs = [event for event in happened if isinstance(event, LegEnded)]
    plans = [event.nodes for event in happened if isinstance(event, Planned)]
    ends = [event for event in happened if isinstance(event, QueryEnded)]
    parts = [_leg(leg) for leg in legs]
    if plans:
        parts.append(_PLANS.format(rows="\n".join(f"        {tuple(nodes)!r}," for nodes in plans)))
    parts += [_OUTCOME.format(query=e.query, outcome=e.outcome.name, collisions=e.collisions) for e in ends]
    changes = _changes(events)
    if changes or not parts:
        parts.append(_MAP.format(rows="\n".join(f"    {row}" for row in changes or ["assert graph.nodes"])))
    return _head(excerpt, legs=bool(legs), plans=bool(plans), ends=bool(ends)) + "".join(parts)


def _head(excerpt: Excerpt, *, legs: bool, plans: bool, ends: bool) -> str:
    names = ["LegEnd", "LegEnded"] * legs + ["Outcome"] * ends + ["Planned"] * plans + ["QueryEnded"] * ends
    times = {"from_s": excerpt.from_s, "to_s": excerpt.to_s}
    head = _HEAD.format(**times, origin=excerpt.recording.name, names=", ".join(names), file=excerpt.output.name)
    return head if names else head.replace("from ltvn_core.nav.events import \n", "")


def _leg(leg: LegEnded) -> str:
    return _LEG.format(
        attempt=leg.attempt,
        source=leg.source,
        start="its_place" if leg.source is None else f"node_{leg.source}",
        target=leg.target,
        verdict="succeeds" if leg.succeeded else "fails",
        end=leg.end.name,
        reason=leg.reason,
        succeeded=leg.succeeded,
    )


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
                rows[node] = f"assert {node} not in graph.nodes"
            case EdgeAdded(edge=edge):
                rows[edge.source, edge.target] = f"assert ({edge.source}, {edge.target}) in graph.edges"
            case EdgePruned(source=source, target=target):
                rows[source, target] = f"assert ({source}, {target}) not in graph.edges"
            case BeliefUpdated(source=source, target=target, belief=belief):
                now = f"graph.edges[{source}, {target}].belief.p"
                rows[source, target] = f"assert {now} == pytest.approx({belief.p:.6g}, abs=1e-6)"
    return list(rows.values())
