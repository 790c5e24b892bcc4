"""When an edge was open and closed, and the prediction for it.

Computes this from observations, for one edge or for the whole map at a moment. `analysis.plan_explanation` explains why
a plan used or avoided an edge that was seen blocked.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.presence.presence_filter import (
    PresenceFilter,
    PresenceObservation,
    follow_histories,
    presence_probabilities,
)
from ltvn_core.graph.presence.presence_plan import HOPELESS_BELOW, OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_LONGEST_S = 14 * 86400.0
"""Longest time ahead, in seconds, in which an edge is predicted to open again."""


class PresenceState(StrEnum):
    """Predicted presence of an edge at one moment."""

    OPEN = "open"
    CLOSED = "closed"
    UNKNOWN = "unknown"
    """The edge was closed, and may be open again."""


@dataclass(frozen=True, slots=True)
class ObservedPresence:
    """One observation of an edge, and its moment in the recording."""

    instant: Instant
    observation: PresenceObservation
    cause: Cause
    attempt: int | None
    """The attempt in which the edge was observed; None if it was seen from a distance or came with the map."""


@dataclass(frozen=True, slots=True)
class PresenceStrip:
    """The probability that an edge is open, at several times."""

    times_s: tuple[float, ...]
    """Times of the world, in seconds."""
    probabilities: tuple[float, ...]

    @property
    def states(self) -> tuple[PresenceState, ...]:
        """The predicted presence at each time."""
        return tuple(presence_state(p) for p in self.probabilities)


def presence_state(p: float) -> PresenceState:
    """Return how the planner treats an edge that is open with probability `p`."""
    if p >= OPEN_ABOVE:
        return PresenceState.OPEN
    return PresenceState.CLOSED if p < HOPELESS_BELOW else PresenceState.UNKNOWN


def observed_presence(
    timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None
) -> tuple[ObservedPresence, ...]:
    """Return the observations of an edge up to an instant, oldest first; linear in the changes of the edge."""
    count = timeline.count_until(until)
    return tuple(
        ObservedPresence(
            instant=change.instant,
            observation=PresenceObservation(change.delta.present, change.delta.stamp),
            cause=change.delta.cause,
            attempt=change.attempt,
        )
        for change in timeline.changes_of_edge(source, target)
        if change.event < count and isinstance(change.delta, PresenceObserved)
    )


def presence_strip(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, times_s: Sequence[float]
) -> PresenceStrip:
    """Return p(open) of an edge at ascending times, each from the observations before that time.

    Times after the last observation are predictions. Linear in observations and times.
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
    return PresenceStrip(tuple(times_s), tuple(found))


def expected_open_s(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, now_s: float
) -> float | None:
    """Return the time at which a closed edge will count as open if nothing more is observed, in seconds; None if it
    counts as open now, or will not within two weeks."""
    tracks = follow_histories(presence_filter, [[seen for seen in observations if seen.stamp_s <= now_s]])
    if tracks.probability(now_s)[0] >= OPEN_ABOVE:
        return None
    ahead_s = np.geomspace(1.0, _LONGEST_S, 200)
    for later_s in ahead_s:
        if tracks.probability(now_s + float(later_s))[0] >= OPEN_ABOVE:
            return now_s + float(later_s)
    return None


def presence_as_if(graph: TopologicalGraph, presence_filter: PresenceFilter, at_s: float) -> dict[EdgeKey, float]:
    """Return p(open) at a time for all edges that were ever seen blocked, from the observations in the map.

    For a time in the past, only earlier observations count.
    """
    histories = list(graph.presence.values())
    found = presence_probabilities(presence_filter, histories, at_s)
    return dict(zip(graph.presence, map(float, found), strict=True))


@dataclass(frozen=True, slots=True)
class PresenceChange:
    """An edge whose state of presence differs between two maps or times, with p(open) of each."""

    edge: EdgeKey
    before: float
    now: float


MapAtTime: TypeAlias = tuple[TopologicalGraph, float]
"""A map, and a time of its world in seconds."""


def presence_difference(
    here: MapAtTime, there: MapAtTime, presence_filter: PresenceFilter, *, edges: Mapping[EdgeKey, EdgeKey]
) -> tuple[PresenceChange, ...]:
    """Return the edges with a different state of presence in two maps, by their names in the map `here`.

    `edges` maps the common edges from the map `here` to the map `there`. Edges that were never seen blocked are open.
    """
    now, before = (presence_as_if(graph, presence_filter, at_s) for graph, at_s in (here, there))
    known = {edge: other for edge, other in edges.items() if edge in now or other in before}
    changes = (PresenceChange(edge, before.get(other, 1.0), now.get(edge, 1.0)) for edge, other in known.items())
    return tuple(each for each in changes if presence_state(each.before) is not presence_state(each.now))
