"""Success rate and size of the map over the queries of a run, and dips of the success rate.

Owns the counts. `analysis.map_comparison` compares the map before and after a dip.
"""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.errors import OptionError
from ltvn_core.graph.deltas import BULK_CAUSES, EdgeAdded, EdgePruned, GraphDelta, NodeAdded, NodeDropped
from ltvn_core.types import FrameId


class SuccessDip(NamedTuple):
    """A run of queries with a success rate clearly below an earlier one. Numbers are rows of `LifelongSuccess`."""

    peak: int
    """The row with the highest success rate before the dip."""
    low: int
    """The row with the lowest success rate."""
    fall: float
    """Decrease of the success rate, as a share of the queries."""
    before: Instant
    """The end of the query at the peak; `before` and `after` are the instants whose maps should be compared."""
    after: Instant
    """The end of the query with the lowest success rate."""


@dataclass(frozen=True, slots=True, eq=False)
class LifelongSuccess:
    """Columns (Q,) with one row for each query that was neither cut nor cancelled."""

    queries: NDArray[np.int64]
    """Numbers of the queries in the recording."""
    ends: tuple[Instant, ...]
    succeeded: NDArray[np.bool_]
    success: NDArray[np.float64]
    """Share of successes in the window that ends at each query; the first windows are shorter."""
    nodes: NDArray[np.int64]
    """Number of nodes in the map after each query."""
    edges: NDArray[np.int64]
    pruned: NDArray[np.int64]
    """Edges that were removed since the previous row, alone or with a node."""
    nodes_added: NDArray[np.int64]
    edges_added: NDArray[np.int64]
    """Edges that were added since the previous row, without those of a whole map."""
    dips: tuple[SuccessDip, ...]

    def until(self, step: FrameId) -> "LifelongSuccess":
        """Return the rows of the queries that had ended at a step, and the dips whose lowest row had been reached."""
        over = sum(end.step <= step for end in self.ends)
        columns = {each.name: getattr(self, each.name)[:over] for each in fields(self) if each.name != "dips"}
        return LifelongSuccess(**columns, dips=tuple(dip for dip in self.dips if dip.after.step <= step))


def lifelong_success(timeline: Timeline, window: int = 10, *, threshold: float = 0.2) -> LifelongSuccess:
    """Return success, map size and changes over the queries; linear in the events.

    A dip is where the success rate of a full window is more than `threshold` below the best earlier one. Raises
    OptionError for a window below one query.
    """
    if window < 1:
        raise OptionError(f"A window has at least 1 query, got {window}.")
    queries = [query for query in timeline.queries if query.succeeded is not None]
    succeeded = np.array([bool(query.succeeded) for query in queries], bool)
    ends = tuple(query.end for query in queries if query.end is not None)
    success = _rolling(succeeded, window)
    counts = _counts(timeline, [query.last for query in queries])
    return LifelongSuccess(
        queries=np.array([query.id for query in queries], np.int64),
        ends=ends,
        succeeded=succeeded,
        success=success,
        nodes=counts[:, 0],
        edges=counts[:, 1],
        pruned=counts[:, 2],
        nodes_added=counts[:, 3],
        edges_added=counts[:, 4],
        dips=_dips(success, ends, window, threshold),
    )


def _rolling(succeeded: NDArray[np.bool_], window: int) -> NDArray[np.float64]:
    """Return (Q,) the share of successes over the last `window` queries."""
    total = np.concatenate([[0], np.cumsum(succeeded)])
    last = np.arange(1, len(total))
    first = np.maximum(last - window, 0)
    return (total[last] - total[first]) / np.maximum(last - first, 1)


def _counts(timeline: Timeline, lasts: list[int]) -> NDArray[np.int64]:
    """Return (Q, 5): nodes and edges after each query; edges pruned, nodes added and edges added since the previous
    query."""
    sizes = timeline.drawing.sizes()
    lost = (-np.diff(sizes[:, 1])).tolist()
    counted = [_counted(change.delta, each) for change, each in zip(timeline.changes, lost, strict=True)]
    totals = np.cumsum([(0, 0, 0), *counted], axis=0)
    over = np.searchsorted([change.event for change in timeline.changes], lasts, "right")
    return np.hstack([sizes[over], np.diff(totals[over], axis=0, prepend=0)])


def _counted(delta: GraphDelta, lost: int) -> tuple[int, int, int]:
    """Return how many edges were pruned, nodes added and edges added by a change after which `lost` edges are
    missing."""
    if delta.cause in BULK_CAUSES:
        return 0, 0, 0
    gone = lost if isinstance(delta, EdgePruned | NodeDropped) else 0
    return gone, int(isinstance(delta, NodeAdded)), int(isinstance(delta, EdgeAdded))


def _dips(
    success: NDArray[np.float64], ends: tuple[Instant, ...], window: int, threshold: float
) -> tuple[SuccessDip, ...]:
    full = success[window - 1 :]
    if not len(full):
        return ()
    best = np.maximum.accumulate(full)
    below = np.flatnonzero(best - full > threshold + 1e-9)
    runs = np.split(below, np.flatnonzero(np.diff(below) > 1) + 1) if len(below) else []
    dips = []
    for run in runs:
        # Rows of all queries, of which the first full window ends at row `window - 1`.
        low = int(run[np.argmin(full[run])]) + window - 1
        peak = int(np.flatnonzero(full[: run[0]] >= best[run[0]] - 1e-9)[-1]) + window - 1
        dips.append(SuccessDip(peak, low, float(success[peak] - success[low]), ends[peak], ends[low]))
    return tuple(dips)
