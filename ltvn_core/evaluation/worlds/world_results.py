"""The results of queries in a changing world as plain data. Field names are the keys of the JSON files, so they stay.

`world_metrics` computes the metrics over results.
"""

from dataclasses import dataclass

from ltvn_core.evaluation.query_result import QueryResult


@dataclass(frozen=True, slots=True)
class DoorMove:
    """A door was closed or opened by the script."""

    at_s: float
    door: int
    is_open: bool


@dataclass(frozen=True, slots=True)
class WorldResult:
    """All queries of one maintenance in one changing scene with one map seed."""

    scene: str
    preset: str
    without: tuple[str, ...]
    seed: int
    world: str
    days: float
    maintenance: str
    nodes: int
    """Of the map before the first query,"""
    edges: int
    true_edges: int
    """and those of its edges that are not spurious."""
    doors: tuple[DoorMove, ...]
    queries: tuple[QueryResult, ...]
    wall_s: float
    version: str
    command: str
