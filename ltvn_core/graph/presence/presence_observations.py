"""What is observed of the presence of edges, as changes of the map: pure functions.

Owns which edges one obstruction closes and one success opens, and that a jam is one observation.
"""

from collections.abc import Collection, Mapping

from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_SAME_S = 20.0
"""What is seen again within this time is the same observation: many tries in one jam are one."""
_ONE_THING_S = 1e-3
"""Several things that are seen at once are told apart by so much time, so that the map knows what closed which edge."""


def obstructed_deltas(
    graph: TopologicalGraph, obstruction: Obstruction, stamp: float, *, driven: EdgeKey | None = None
) -> tuple[PresenceObserved, ...]:
    """Return that all edges are blocked whose ways are closed, and the driven one if it stopped the robot on it."""
    stopped = [driven] if obstruction.stopped and driven in graph.edges and driven is not None else []
    closed: dict[EdgeKey, float] = dict.fromkeys(stopped, stamp)
    for number, thing in enumerate(obstruction.things()):
        keys = edges_obstructed(graph, thing)
        moment = _moment(graph, keys, stamp + number * _ONE_THING_S)
        closed |= {key: moment for key in keys}
    return _observed(graph, closed, present=False, driven=driven)


def _moment(graph: TopologicalGraph, keys: Collection[EdgeKey], stamp: float) -> float:
    """Return when one thing was seen: at the moment of the same observation if this is not the first look."""
    last = [graph.presence[key][-1] for key in keys if key in graph.presence]
    return max(
        (seen.stamp_s for seen in last if not seen.present and 0 <= stamp - seen.stamp_s < _SAME_S), default=stamp
    )


def open_deltas(graph: TopologicalGraph, driven: EdgeKey, stamp: float) -> tuple[PresenceObserved, ...]:
    """Return that a driven edge is open, and all edges that the same thing closed; none if never."""
    return _opened(graph, {driven}, stamp, driven=driven)


def seen_open_deltas(graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float) -> tuple[PresenceObserved, ...]:
    """Return that edges are open whose ways were seen to be free, and all edges that the same thing closed."""
    return _opened(graph, seen, stamp, driven=None)


def is_open(graph: TopologicalGraph, edge: EdgeKey) -> bool:
    """Tell whether an edge was open when it was last looked at; one that was never seen blocked is."""
    return edge not in graph.presence or graph.presence[edge][-1].present


def _opened(
    graph: TopologicalGraph, keys: Collection[EdgeKey], stamp: float, *, driven: EdgeKey | None
) -> tuple[PresenceObserved, ...]:
    known = [key for key in keys if key in graph.presence]
    moments = {seen.stamp_s for key in known for seen in graph.presence[key] if not seen.present}
    together = [key for key, history in graph.presence.items() if any(seen.stamp_s in moments for seen in history)]
    return _observed(graph, dict.fromkeys((*known, *together), stamp), present=True, driven=driven)


def _observed(
    graph: TopologicalGraph, stamps: Mapping[EdgeKey, float], *, present: bool, driven: EdgeKey | None
) -> tuple[PresenceObserved, ...]:
    """Return one observation of each edge, but not the same one twice within a short time."""
    deltas = []
    for key, stamp in stamps.items():
        last = graph.presence[key][-1] if key in graph.presence else None
        if last is not None and last.present == present and 0 <= stamp - last.stamp_s < _SAME_S:
            continue
        in_order = stamp if last is None else max(stamp, last.stamp_s)
        cause = Cause.ATTEMPT if key == driven else Cause.SIGHT
        deltas.append(PresenceObserved(*key, present=present, stamp=in_order, cause=cause))
    return tuple(deltas)
