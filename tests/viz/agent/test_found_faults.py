"""A script without any model finds faults that were planted in maps, in a few calls of the tools."""

import re
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.build import BuildVerb
from ltvn_core.verbs.collect import CollectVerb
from tests.repository import DEMO_DRIVE
from tests.viz.agent.agent_client import AgentClient, agent_client
from tools.plant_faults import FaultKind, plant_faults

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


def plant(map_file: Path, folder: Path, kind: FaultKind) -> Planted:
    """Plant one fault, and let the robot meet it."""
    recording = folder / f"{kind}.rrd"
    planted = plant_faults(map_file, recording, (kind,))
    assert planted.outcome.reached == 0
    return Planted(recording, planted.faults[0].edges)


def test_an_edge_through_a_wall_and_a_missing_one_are_found_in_a_few_calls(tmp_path: Path) -> None:
    drive, map_file = tmp_path / "drive.rrd", tmp_path / "map.rrd"
    CollectVerb(output=drive, loops=1).run()
    BuildVerb(recordings=(drive,), output=map_file, predictor="oracle").run()

    for kind in (FaultKind.SPURIOUS_EDGE, FaultKind.MISSING_EDGE):
        check_found(plant(map_file, tmp_path, kind), kind)


def test_two_places_that_look_alike_are_found_in_a_few_calls(tmp_path: Path) -> None:
    # Only a network takes one place for another; the drive ends with a map that a network built.
    check_found(plant(DEMO_DRIVE, tmp_path, FaultKind.PERCEPTUAL_ALIAS), FaultKind.PERCEPTUAL_ALIAS)


def check_found(planted: Planted, kind: FaultKind) -> None:
    with agent_client(planted.recording) as agent:
        finding = find_fault(agent)

    assert finding.kind == kind
    assert finding.edge in planted.edges
    assert finding.calls <= MOST_CALLS
