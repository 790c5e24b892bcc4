"""Edges that are closed for now are drawn as such in the Rerun viewer."""

from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from ltvn_core import palette
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.deltas import Cause, EdgePruned, PresenceObserved
from ltvn_core.graph.topological_graph import TopologicalGraph
from tests.core.graph.small_maps import edge_added, node_added

ENDS = f"{schema.EDGE_ROW}:source", f"{schema.EDGE_ROW}:target"
COLUMNS = (*ENDS, "LineStrips3D:strips", "LineStrips3D:colors")
FAR_APART_S = 10.0
"""The map is drawn twice a second at most."""


def looked(source: int, target: int, *, present: bool, stamp: float) -> PresenceObserved:
    return PresenceObserved(source, target, present=present, stamp=stamp, cause=Cause.SIGHT)


def recorded(path: Path, *changes: PresenceObserved | EdgePruned) -> list[dict[str, Any]]:
    """Return what is drawn of closed edges of a map with two edges, after each change of them."""
    graph = TopologicalGraph([node_added(0), node_added(1, 1.0), edge_added(0, 1), edge_added(1, 0, -1.0)])
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        writer.draw_graph(graph, 0, 0.0)
        for number, change in enumerate(changes, 1):
            graph.apply(change)
            writer.draw_graph(graph, 100 * number, FAR_APART_S * number)
    chunks = [chunk for chunk in RrdReader(path).stream() if chunk.entity_path == f"/{schema.BLOCKED}"]
    batches = [chunk.to_record_batch() for chunk in chunks]
    rows = [row for batch in batches for row in batch.select([schema.STEP, *COLUMNS]).to_pylist()]
    return sorted(rows, key=lambda row: row[schema.STEP])


def ends(row: dict[str, Any]) -> list[tuple[int, int]]:
    return list(zip(*(row[column] for column in ENDS), strict=True))


def test_an_edge_is_drawn_as_blocked_until_it_is_seen_open_again(tmp_path: Path) -> None:
    rows = recorded(
        tmp_path / "drive.rrd", looked(0, 1, present=False, stamp=1.0), looked(0, 1, present=True, stamp=2.0)
    )

    assert [ends(row) for row in rows] == [[(0, 1)], []]


def test_an_edge_that_is_pruned_is_no_longer_blocked(tmp_path: Path) -> None:
    rows = recorded(
        tmp_path / "drive.rrd",
        looked(0, 1, present=False, stamp=1.0),
        looked(1, 0, present=False, stamp=1.0),
        EdgePruned(0, 1, Cause.ATTEMPT),
    )

    assert [ends(row) for row in rows] == [[(0, 1)], [(0, 1), (1, 0)], [(1, 0)]]


def test_blocked_edges_have_the_colour_of_the_page_and_lie_over_the_others(tmp_path: Path) -> None:
    row = recorded(tmp_path / "drive.rrd", looked(0, 1, present=False, stamp=1.0))[-1]

    (colour,) = row["LineStrips3D:colors"]
    assert (colour >> 24 & 255, colour >> 16 & 255, colour >> 8 & 255) == palette.EDGE_REMOVED
    (strip,) = row["LineStrips3D:strips"]
    assert [[round(part, 2) for part in point] for point in strip] == [[0.0, 0.0, 0.08], [1.0, 0.0, 0.08]]
