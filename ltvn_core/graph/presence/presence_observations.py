"""Observations of presence as changes of the map: pure functions.

Owns the choice of edges that one obstruction closes and one success opens, and counts many attempts at one blockage as
one observation.
"""

import itertools
from collections.abc import Collection, Mapping

from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.presence.obstruction import Obstruction, edges_obstructed
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_SAME_S = 20.0
"""Time in seconds within which equal observations count as one, so that many attempts at one blockage count once."""
_SEEN_SHARE = 0.3
"""Least share of the edges closed by a thing that must be seen free before the thing counts as gone."""
_ONE_THING_S = 1e-3
"""Offset in seconds between the stamps of things seen at once, which identifies the edges that each of them closed."""


def obstructed_deltas(
    graph: TopologicalGraph, obstruction: Obstruction, stamp: float, *, driven: EdgeKey | None = None
) -> tuple[PresenceObserved, ...]:
    """Return observations that all closed edges are blocked, and the driven edge if the robot was stopped there."""
    stopped = [driven] if obstruction.stopped and driven in graph.edges and driven is not None else []
    closed: dict[EdgeKey, float] = dict.fromkeys(stopped, stamp)
    for number, thing in enumerate(obstruction.things()):
        keys = edges_obstructed(graph, thing)
        moment = _moment(graph, keys, stamp + number * _ONE_THING_S)
        closed |= {key: moment for key in keys}
    return _observed(graph, closed, present=False, driven=driven)


def _moment(graph: TopologicalGraph, keys: Collection[EdgeKey], stamp: float) -> float:
    """Return the stamp for a thing: the time of an earlier observation of the same blockage, or else `stamp`."""
    last = [graph.presence[key][-1] for key in keys if key in graph.presence]
    return max(
        (seen.stamp_s for seen in last if not seen.present and 0 <= stamp - seen.stamp_s < _SAME_S), default=stamp
    )


def open_deltas(graph: TopologicalGraph, driven: EdgeKey, stamp: float) -> tuple[PresenceObserved, ...]:
    """Return observations that a driven edge and all edges closed by the same thing are open; none if the driven edge
    was never blocked."""
    if driven not in graph.presence:
        return ()
    together = itertools.chain.from_iterable(_closed_together(graph, {driven}))
    return _observed(graph, dict.fromkeys((driven, *together), stamp), present=True, driven=driven)


def seen_open_deltas(graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float) -> tuple[PresenceObserved, ...]:
    """Return observations that edges seen free, and the other edges closed by the same thing, are open.

    The other edges count as open only if a large enough share of the thing's edges was seen free, because a few paths
    may be free although the thing is still there.
    """
    known = [key for key in seen if key in graph.presence]
    groups = _closed_together(graph, known)
    gone = (keys for keys in groups if len(keys.intersection(known)) >= _SEEN_SHARE * len(keys))
    opened = dict.fromkeys((*known, *itertools.chain.from_iterable(gone)), stamp)
    return _observed(graph, opened, present=True, driven=None)


def _closed_together(graph: TopologicalGraph, keys: Collection[EdgeKey]) -> list[set[EdgeKey]]:
    """Return, for each moment at which one of `keys` was seen closed, all edges that were last seen closed at that
    moment.

    An edge that was seen closed again later is closed by something else.
    """
    groups = {seen.stamp_s: set[EdgeKey]() for key in keys for seen in graph.presence[key] if not seen.present}
    for key, history in graph.presence.items() if groups else ():
        closed_s = next((seen.stamp_s for seen in reversed(history) if not seen.present), None)
        if closed_s in groups:
            groups[closed_s].add(key)
    return list(groups.values())


def is_open(graph: TopologicalGraph, edge: EdgeKey) -> bool:
    """Return whether an edge was open at its last observation; an edge without observations is open."""
    return edge not in graph.presence or graph.presence[edge][-1].present


def _observed(
    graph: TopologicalGraph, stamps: Mapping[EdgeKey, float], *, present: bool, driven: EdgeKey | None
) -> tuple[PresenceObserved, ...]:
    """Return one observation of each edge, except those with the same observation a short time before."""
    deltas = []
    for key, stamp in stamps.items():
        last = graph.presence[key][-1] if key in graph.presence else None
        if last is not None and last.present == present and 0 <= stamp - last.stamp_s < _SAME_S:
            continue
        in_order = stamp if last is None else max(stamp, last.stamp_s)
        cause = Cause.ATTEMPT if key == driven else Cause.SIGHT
        deltas.append(PresenceObserved(*key, present=present, stamp=in_order, cause=cause))
    return tuple(deltas)
