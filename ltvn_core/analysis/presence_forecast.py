"""The probability that edges are open, at any time: in the past, now, and predicted.

`analysis.edge_story` holds when an edge was seen open or blocked, `analysis.plan_explanation` explains why a plan used
or avoided an edge that was seen blocked.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ltvn_core.graph.presence.edge_presence import HOPELESS_BELOW, OPEN_ABOVE
from ltvn_core.graph.presence.presence_filter import (
    PresenceFilter,
    PresenceObservation,
    follow_histories,
)
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

_LONGEST_S = 14 * 86400.0
"""Longest time ahead, in seconds, in which an edge is predicted to open again."""


class PresenceState(StrEnum):
    """Predicted presence of an edge at one moment."""

    OPEN = "open"
    CLOSED = "closed"
    UNKNOWN = "unknown"
    """The edge was closed, and may be open again."""


def presence_state(p: float) -> PresenceState:
    """Return how the planner treats an edge that is open with probability `p`."""
    if p >= OPEN_ABOVE:
        return PresenceState.OPEN
    return PresenceState.CLOSED if p < HOPELESS_BELOW else PresenceState.UNKNOWN


def presence_over_time(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, times_s: Sequence[float]
) -> tuple[float, ...]:
    """Return p(open) of an edge at ascending times, in seconds of the world, each from the observations before it.

    Values after the last observation are predictions. Linear in observations and times.
    """
    tracks = presence_filter.follow(1)
    row = np.zeros(1, np.intp)
    found = []
    next_look = 0
    for at_s in times_s:
        while next_look < len(observations) and observations[next_look].stamp_s <= at_s:
            seen = observations[next_look]
            tracks.observe(row, np.array([seen.present]), np.array([seen.stamp_s]))
            next_look += 1
        found.append(float(tracks.probability(at_s)[0]))
    return tuple(found)


def expected_open_s(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, now_s: float
) -> float | None:
    """Return the time at which a closed edge will count as open if nothing more is observed, in seconds; None if it
    counts as open now, or will not within two weeks."""
    tracks = follow_histories(presence_filter, [[seen for seen in observations if seen.stamp_s <= now_s]])
    if tracks.probability(now_s)[0] >= OPEN_ABOVE:
        return None
    later = (now_s + float(ahead_s) for ahead_s in np.geomspace(1.0, _LONGEST_S, 200))
    return next((at_s for at_s in later if tracks.probability(at_s)[0] >= OPEN_ABOVE), None)


def presence_as_if(graph: TopologicalGraph, presence_filter: PresenceFilter, at_s: float) -> dict[EdgeKey, float]:
    """Return p(open) at a time for all edges that were ever seen blocked, from the observations in the map.

    For a time in the past, only earlier observations count.
    """
    known = [[seen for seen in history if seen.stamp_s <= at_s] for history in graph.presence.values()]
    found = follow_histories(presence_filter, known).probability(at_s)
    return dict(zip(graph.presence, map(float, found), strict=True))


class PresenceChange(NamedTuple):
    """An edge whose state of presence differs between two maps or times, with p(open) of each."""

    edge: EdgeKey
    before: float
    now: float

    @property
    def states(self) -> tuple[PresenceState, PresenceState]:
        """The states before and now."""
        return presence_state(self.before), presence_state(self.now)


def presence_changes(
    before: Mapping[EdgeKey, float], now: Mapping[EdgeKey, float], edges: Mapping[EdgeKey, EdgeKey]
) -> tuple[PresenceChange, ...]:
    """Return the edges with a different state in two maps or at two times, from p(open) by `presence_as_if`.

    `edges` maps the common edges from the map of now to that of before. Edges that were never seen blocked are open.
    """
    changes = (PresenceChange(edge, before.get(other, 1.0), now.get(edge, 1.0)) for edge, other in edges.items())
    return tuple(each for each in changes if each.states[0] is not each.states[1])
