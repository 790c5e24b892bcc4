"""What is observed of the presence of edges, as changes of the map: pure functions.

Owns which edges one obstruction closes and one success opens, and that a jam is one observation.
"""

from collections.abc import Iterable

from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_ONE_OBSERVATION_S = 20.0
"""What is seen again within this time is the same observation: many tries in one jam are one."""


def obstructed_deltas(
    graph: TopologicalGraph, obstruction: Obstruction, stamp: float, *, driven: EdgeKey | None = None
) -> tuple[PresenceObserved, ...]:
    """Return that all edges are blocked whose ways are closed, and the driven one if it stopped the robot on it."""
    stopped = [driven] if obstruction.stopped and driven in graph.edges and driven is not None else []
    keys = dict.fromkeys((*stopped, *edges_obstructed(graph, obstruction)))
    return _observed(graph, keys, stamp, present=False, driven=driven)


def open_deltas(graph: TopologicalGraph, driven: EdgeKey, stamp: float) -> tuple[PresenceObserved, ...]:
    """Return that a driven edge is open, and all edges that were seen blocked together with it; none if never."""
    if driven not in graph.presence:
        return ()
    moments = {seen.stamp_s for seen in graph.presence[driven] if not seen.present}
    together = [key for key, history in graph.presence.items() if any(seen.stamp_s in moments for seen in history)]
    return _observed(graph, dict.fromkeys((driven, *together)), stamp, present=True, driven=driven)


def _observed(
    graph: TopologicalGraph, keys: Iterable[EdgeKey], stamp: float, *, present: bool, driven: EdgeKey | None
) -> tuple[PresenceObserved, ...]:
    """Return one observation of each edge, but not the same one twice within a short time."""
    deltas = []
    for key in keys:
        last = graph.presence[key][-1] if key in graph.presence else None
        if last is not None and last.present == present and 0 <= stamp - last.stamp_s < _ONE_OBSERVATION_S:
            continue
        in_order = stamp if last is None else max(stamp, last.stamp_s)
        cause = Cause.ATTEMPT if key == driven else Cause.SIGHT
        deltas.append(PresenceObserved(*key, present=present, stamp=in_order, cause=cause))
    return tuple(deltas)
