"""The map on show as rows of integers, which pages fetch piece by piece as the map changes.

Each change of the map makes a new version. A page asks for what changed since the version that it has, so a page that
lags behind, or was just opened, needs no special case. Rows are made in the painter's thread and read in others.
"""

import threading
from collections import deque
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.map_history import EMPTY_GRAPH, GraphArrays

_KEPT = 64
"""Number of versions after which a page gets the whole map again."""
_SHIFT = 32

Rows = NDArray[np.int64]
"""(N, C) integers whose first column is a key, in ascending order of it."""


class _Version(NamedTuple):
    """The keys of nodes and edges that changed in one version."""

    number: int
    nodes: NDArray[np.int64]
    edges: NDArray[np.int64]


class MapChanges:
    """The map on show, and what changed in its latest versions."""

    def __init__(self) -> None:
        """Start with an empty map, which is version 0."""
        self._lock = threading.Lock()
        self._graph = EMPTY_GRAPH
        self._nodes = node_rows(EMPTY_GRAPH)
        self._edges = edge_rows(EMPTY_GRAPH)
        self._versions: deque[_Version] = deque(maxlen=_KEPT)
        self._number = 0

    def take(self, graph: GraphArrays) -> int:
        """Set the map on show and return the number of its version; constant time for the same map."""
        if graph is self._graph:
            return self._number
        nodes = node_rows(graph)
        edges = edge_rows(graph)
        touched = _touched(self._nodes, nodes), _touched(self._edges, edges)
        with self._lock:
            self._graph, self._nodes, self._edges = graph, nodes, edges
            if any(map(len, touched)):
                self._number += 1
                self._versions.append(_Version(self._number, *touched))
        return self._number

    def since(self, known: int) -> bytes:
        """Return as JSON what differs from version `known`: the whole map for 0, and for a version too long ago.

        Rows of nodes are id, x and y in mm, yaw in mrad, and 1 if an edge with an action begins there; rows of edges
        are source, target, p in thousandths, and 1 if the edge needs an action.
        """
        with self._lock:
            nodes, edges, number = self._nodes, self._edges, self._number
            missed = [each for each in self._versions if each.number > known]
        is_whole = not 0 < known <= number or len(missed) != number - known
        changed_nodes = nodes[:, 0] if is_whole else _union([each.nodes for each in missed])
        changed_edges = edges[:, 0] if is_whole else _union([each.edges for each in missed])
        new_edges = edges[np.isin(edges[:, 0], changed_edges)]
        gone_edges = np.setdiff1d(changed_edges, edges[:, 0])
        changes = {
            "version": number,
            "whole": is_whole,
            "nodes": nodes[np.isin(nodes[:, 0], changed_nodes)].tolist(),
            "goneNodes": np.setdiff1d(changed_nodes, nodes[:, 0]).tolist(),
            "edges": np.column_stack([*_ends(new_edges[:, 0]), new_edges[:, 1:]]).tolist(),
            "goneEdges": np.column_stack(_ends(gone_edges)).tolist(),
        }
        return msgspec.json.encode(changes)


def node_rows(graph: GraphArrays) -> Rows:
    """Return a row for each node: id, x and y in mm, yaw in mrad, and whether an edge with an action begins there."""
    places = np.rint(1000 * graph.poses).astype(np.int64)
    return _sorted(np.column_stack([graph.ids, places, graph.exits.astype(np.int64)]))


def edge_rows(graph: GraphArrays) -> Rows:
    """Return a row for each edge: a key made of source and target, p in thousandths, and whether it needs an action."""
    source, target = graph.ids[graph.edges].T
    p = np.rint(1000 * graph.p).astype(np.int64)
    return _sorted(np.column_stack([(source << _SHIFT) | target, p, graph.acts.astype(np.int64)]))


def _sorted(rows: Rows) -> Rows:
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _touched(old: Rows, new: Rows) -> NDArray[np.int64]:
    """Return the keys of all rows that were added, removed or changed."""
    both, in_old, in_new = np.intersect1d(old[:, 0], new[:, 0], assume_unique=True, return_indices=True)
    same = both[(old[in_old] == new[in_new]).all(axis=1)]
    return np.setdiff1d(np.union1d(old[:, 0], new[:, 0]), same, assume_unique=True)


def _union(keys: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.unique(np.concatenate(keys)) if keys else np.empty(0, np.int64)


def _ends(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return keys >> _SHIFT, keys & ((1 << _SHIFT) - 1)
