"""A script without any model finds faults that were planted in maps, in a few calls of the tools."""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from ltvn_core.verbs.jobs.plant import PlantSummary
from ltvn_core.verbs.plant import FaultName, PlantVerb
from tests.repository import DEMO_DRIVE, DEMO_MAP
from tests.viz.agent.agent_client import AgentClient, agent_client

MOST_CALLS = 12

Edge = tuple[int, int]


@dataclass(frozen=True)
class Finding:
    """What the script says is wrong with the map, and how often it had to call for it."""

    kind: str
    edge: Edge | None
    calls: int


def find_fault(agent: AgentClient) -> Finding:
    """Look for what is wrong with the only map that is there, without its truth.

    The answer about the first query that failed names the edge that it failed at, the edges that odometry contradicts,
    and where the map has a gap before the goal. An edge that closes the gap must lead to a plan.
    """
    file = agent.ask("list_files")["files"][0]["file"]
    failed = next(query for query in agent.ask("describe", file=file)["queries"] if not query["succeeded"])
    told = agent.ask("ask", file=file, query=failed["query"])["text"]
    if failed["outcome"] == "no path":
        edge = _bridge(agent, file, failed["end_s"], _rows(told, "nearest across the gap"))
        return Finding("missing-edge", edge, agent.calls)
    contradicted = _rows(told, "contradicted edge")
    if contradicted:
        return Finding("look-alike", contradicted[0], agent.calls)
    found = re.search(r"It drove edge (\d+) → (\d+)", told)
    return Finding("spurious-edge", found and (int(found[1]), int(found[2])), agent.calls)


def _bridge(agent: AgentClient, file: str, at_s: float, nearest: list[Edge]) -> Edge | None:
    """Try missing edges until with one of them there is a way."""
    for edge in nearest[: MOST_CALLS - agent.calls]:
        text = f"with {edge[0]}->{edge[1]}"
        if "instead of no way" in agent.ask("ask", file=file, question="what-if", at_s=at_s, text=text)["text"]:
            return edge
    return None


def _rows(text: str, head: str) -> list[Edge]:
    """Return the edges of the table whose first column has that name."""
    found: list[Edge] = []
    for line in text.partition(f"\n{head}")[2].splitlines()[1:]:
        edge = re.match(r"(\d+) → (\d+) ", line)
        if edge is None:
            break
        found.append((int(edge[1]), int(edge[2])))
    return found


@dataclass(frozen=True)
class Planted:
    """A recording with one fault."""

    recording: Path
    edges: tuple[Edge, ...]


MAPS: dict[FaultName, Path] = {"spurious-edge": DEMO_DRIVE, "missing-edge": DEMO_MAP, "look-alike": DEMO_DRIVE}
"""The drive ends with the smaller map; but where an edge is missing in it, others close the gap as well."""


def plant(folder: Path, kind: FaultName) -> Planted:
    """Plant one fault, and let the robot meet it."""
    recording = folder / f"{kind}.rrd"
    summary = PlantVerb(map=MAPS[kind], recording=recording, fault=(kind,)).run()
    assert isinstance(summary, PlantSummary)
    assert summary.outcome.reached == 0
    return Planted(recording, tuple((source, target) for source, target in summary.faults[0].edges))


@pytest.mark.parametrize("kind", MAPS)
def test_a_fault_of_each_kind_is_found_in_a_few_calls(kind: FaultName, tmp_path: Path) -> None:
    planted = plant(tmp_path, kind)
    with agent_client(planted.recording) as agent:
        finding = find_fault(agent)

    assert finding.kind == kind
    assert finding.edge in planted.edges
    assert finding.calls <= MOST_CALLS
