"""Generates the source of a regression test for what happened in an excerpt of a recording.

The test asserts what happened, right or wrong; the user edits it to what should have happened. A recording may come
from an untrusted source, so its texts are escaped to ASCII and cannot become code.
"""

import math
from collections.abc import Sequence

from ltvn_core.graph import deltas as d
from ltvn_core.navigation.events import AttemptEnded, GraphChanged, QueryEnded, StampedEvent

_TEST = '''"""What happened in {about}.

Each test says what did happen. Change what should have happened differently, and keep the rest.
"""

from pathlib import Path

import pytest

from ltvn_core.data.recording.reader import Recording
from ltvn_core.navigation.events import AttemptEnd, AttemptEnded, Outcome, QueryEnded

RECORDING = Path(__file__).parent / "{file}"


@pytest.fixture(scope="module")
def moment() -> Recording:
    return Recording.open(RECORDING)


def test_attempts_end_as_they_did(moment: Recording) -> None:
    ends = [stamped.event for stamped in moment.events if isinstance(stamped.event, AttemptEnded)]
    assert [(each.attempt, each.source, each.target, each.end, each.succeeded) for each in ends] == [{attempts}]


def test_queries_end_as_they_did(moment: Recording) -> None:
    ends = [stamped.event for stamped in moment.events if isinstance(stamped.event, QueryEnded)]
    assert [(each.query, each.outcome) for each in ends] == [{queries}]
'''

_MAP = """

def test_the_map_afterwards(moment: Recording) -> None:
    graph = moment.final_graph()
{changes}
"""


def regression_test_source(events: Sequence[StampedEvent], *, file: str, about: str) -> str:
    """Return a pytest module that opens the recording `file` in its own folder and asserts the given events.

    `events` are those of the excerpt, without the ones that made the map at its start; `about` names the excerpt in a
    few words.
    """
    happened = [stamped.event for stamped in events]
    ended = [event for event in happened if isinstance(event, QueryEnded)]
    queries = ", ".join(f"({int(each.query)}, Outcome.{each.outcome.name})" for each in ended)
    attempts = "".join(_attempt_row(event) for event in happened if isinstance(event, AttemptEnded))
    attempts = attempts and f"\n{attempts}    "
    test = _TEST.format(about=_escaped(about), file=_escaped(file), attempts=attempts, queries=queries)
    changes = _changes(events)
    return test + _MAP.format(changes="\n".join(f"    {row}" for row in changes)) * bool(changes)


def _attempt_row(ended: AttemptEnded) -> str:
    source = None if ended.source is None else int(ended.source)
    row = f"{int(ended.attempt)}, {source}, {int(ended.target)}, AttemptEnd.{ended.end.name}, {bool(ended.succeeded)}"
    return f"        ({row}),  # {_escaped(ended.reason)}\n"


def _escaped(text: str) -> str:
    """Return a text in printable ASCII on one line, so that it is safe in a comment and between double quotes."""
    return ascii(text)[1:-1].replace('"', '\\"')


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
