"""Floors of a map: the parts that only edges with an action join with each other."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


def number_floors(nodes: NDArray[np.int64], edges: NDArray[np.int64], acts: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the floor (N,) of each of N nodes, from 0, the largest floor.

    A map without actions is one floor. Pieces that no edge at all joins with the rest belong to the largest floor.
    Linear in nodes and edges.

    Args:
        nodes: Ids of the nodes (N,).
        edges: Rows of source and target in `nodes` (E, 2).
        acts: Whether each edge needs an action (E,).
    """
    count = len(nodes)
    if not acts.any():
        return np.zeros(count, np.intp)
    driven = edges[~acts]
    joined = coo_array((np.ones(len(driven), np.bool_), (driven[:, 0], driven[:, 1])), shape=(count, count))
    _, piece_of = connected_components(joined, directed=False)
    between = piece_of[edges[acts]]
    pieces = np.unique(between[between[:, 0] != between[:, 1]])
    sizes = np.bincount(piece_of)[pieces]
    first = np.array([nodes[piece_of == piece].min() for piece in pieces])
    number_of = np.zeros(piece_of.max() + 1, np.intp)
    number_of[pieces[np.lexsort((first, -sizes))]] = np.arange(len(pieces))
    return number_of[piece_of]
