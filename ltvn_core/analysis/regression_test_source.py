"""Generates the source of a regression test for what happened in an excerpt of a recording.

The test asserts what happened, right or wrong; the user edits it to what should have happened. A recording may come
from an untrusted source, so its texts are escaped to ASCII and cannot become code.
"""

import math
import textwrap
from collections.abc import Sequence

from ltvn_core.graph import deltas as d
from ltvn_core.navigation.events import AttemptEnded, GraphChanged, Planned, QueryEnded, StampedEvent
from ltvn_core.types import NodeId

_HEAD = '''"""What happened in {about}.

Each test says what did happen. Change what should have happened differently, and keep the rest.
"""

from pathlib import Path

import pytest

from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import {names}
from ltvn_core.data.recording.reader import Recording

RECORDING = Path(__file__).parent / {file}


@pytest.fixture(scope="module")
def moment() -> Recording:
    return Recording.open(RECORDING)
'''

_ATTEMPTS = """

@pytest.mark.parametrize(
    ("attempt", "source", "target", "end", "succeeded"),
    [
{rows}
    ],
)
def test_attempts_end_as_they_did(
    moment: Recording, attempt: int, source: int | None, target: int, end: AttemptEnd, succeeded: bool
) -> None:
    ends = [stamped.event for stamped in moment.events if isinstance(stamped.event, AttemptEnded)]
    found = {{ended.attempt: ended for ended in ends}}[attempt]
    assert (found.source, found.target, found.end, found.succeeded) == (source, target, end, succeeded)
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

def test_query_{name}_ended(moment: Recording) -> None:
    ends = {{stamped.event.query: stamped.event for stamped in moment.events if isinstance(stamped.event, QueryEnded)}}
    assert ends[{query}].outcome is Outcome.{outcome}
    assert ends[{query}].collisions == {collisions}
"""

_MAP = """

def test_the_map_afterwards(moment: Recording) -> None:
    graph: TopologicalGraph = moment.final_graph()
{rows}
"""


def regression_test_source(events: Sequence[StampedEvent], *, file: str, about: str) -> str:
    """Return a pytest module that opens the recording `file` in its own folder and asserts the given events.

    `events` are those of the excerpt, without the ones that made the map at its start; `about` names the excerpt in a
    few words.
    """
    happened = [stamped.event for stamped in events]
    attempts = [event for event in happened if isinstance(event, AttemptEnded)]
    plans = [event.nodes for event in happened if isinstance(event, Planned)]
    ends = [event for event in happened if isinstance(event, QueryEnded)]
    parts = [_ATTEMPTS.format(rows="\n".join(map(_attempt_row, attempts)))] if attempts else []
    if plans:
        parts.append(_PLANS.format(count=len(plans), first=_wrapped(plans[0]), last=_wrapped(plans[-1])))
    parts += [_outcome(ended) for ended in ends]
    changes = _changes(events)
    if changes or not parts:
        parts.append(_MAP.format(rows="\n".join(f"    {row}" for row in changes or ["assert graph.nodes"])))
    return _head(file, about, attempts=bool(attempts), plans=bool(plans), ends=bool(ends)) + "".join(parts)


def _head(file: str, about: str, *, attempts: bool, plans: bool, ends: bool) -> str:
    names = ["AttemptEnd", "AttemptEnded"] * attempts + ["Outcome"] * ends + ["Planned"] * plans + ["QueryEnded"] * ends
    head = _HEAD.format(about=_escaped(about), names=", ".join(names), file=f'"{_escaped(file)}"')
    return head if names else head.replace("from ltvn_core.navigation.events import \n", "")


def _attempt_row(ended: AttemptEnded) -> str:
    source = None if ended.source is None else int(ended.source)
    row = f"{int(ended.attempt)}, {source}, {int(ended.target)}, AttemptEnd.{ended.end.name}, {bool(ended.succeeded)}"
    return f"        ({row}),  # {_escaped(ended.reason)}"


def _outcome(ended: QueryEnded) -> str:
    query = int(ended.query)
    name = str(query).replace("-", "minus_")
    return _OUTCOME.format(name=name, query=query, outcome=ended.outcome.name, collisions=int(ended.collisions))


def _escaped(text: str) -> str:
    """Return a text in printable ASCII on one line, so that it is safe in a comment and between double quotes."""
    return ascii(text)[1:-1].replace('"', '\\"')


def _wrapped(nodes: Sequence[NodeId]) -> str:
    text = "".join(f"{int(node)}, " for node in nodes)
    return textwrap.fill(text, 118, initial_indent=" " * 8, subsequent_indent=" " * 8)


def _changes(events: Sequence[StampedEvent]) -> list[str]:
    """Return assertions for the final state of all nodes and edges that the excerpt changed."""
    rows: dict[object, str] = {}
    for stamped in events:
        if not isinstance(stamped.event, GraphChanged):
            continue
        match stamped.event.delta:
            case d.NodeAdded(node=node):
                rows[node.id] = f"assert {node.id} in graph.nodes"
            case d.NodeDropped(node=node):
                # The edges of the node were removed with it.
                rows = {key: row for key, row in rows.items() if not (isinstance(key, tuple) and node in key)}
                rows[node] = f"assert {node} not in graph.nodes"
            case d.EdgeAdded(edge=edge):
                rows[edge.source, edge.target] = f"assert ({edge.source}, {edge.target}) in graph.edges"
            case d.EdgePruned(source=source, target=target):
                rows[source, target] = f"assert ({source}, {target}) not in graph.edges"
            case d.BeliefUpdated(source=source, target=target, belief=belief):
                now = f"graph.edges[{source}, {target}].belief.p"
                p = f"{belief.p:.6g}" if math.isfinite(belief.p) else f'float("{float(belief.p)}")'
                rows[source, target] = f"assert {now} == pytest.approx({p}, abs=1e-6)"
            case _:
                pass  # This changes neither nodes nor edges nor beliefs.
    return list(rows.values())
