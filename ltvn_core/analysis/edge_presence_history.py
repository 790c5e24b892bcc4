"""When an edge was open and when closed, what is expected of it next, and what it would be like at another time.

Owns these questions for one edge or for the whole map at a moment, as pure functions of what was observed. Says nothing
in words and draws nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.presence.observation import PresenceObservation
from ltvn_core.graph.presence.presence_filter import PresenceFilter, follow_histories, presence_probabilities
from ltvn_core.graph.presence.presence_plan import HOPELESS_BELOW, OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_LONGEST_S = 14 * 86400.0
"""A return that is expected later than this is none."""


class PresenceState(StrEnum):
    """What is believed of an edge at a moment."""

    OPEN = "open"
    CLOSED = "closed"
    UNKNOWN = "unknown"
    """It was closed, and may be open again."""


@dataclass(frozen=True, slots=True)
class ObservedPresence:
    """One observation of an edge, with where it stands in the recording."""

    instant: Instant
    observation: PresenceObservation
    cause: Cause
    attempt: int | None
    """The attempt that it was learned from; None where it was seen from afar or came with the map."""


@dataclass(frozen=True, slots=True)
class PresenceStrip:
    """The probability that an edge is open, over time."""

    times_s: tuple[float, ...]
    """On the clock of the world."""
    probabilities: tuple[float, ...]

    @property
    def states(self) -> tuple[PresenceState, ...]:
        """What is believed at each time."""
        return tuple(presence_state(p) for p in self.probabilities)


def presence_state(p: float) -> PresenceState:
    """Return what a probability means to the planner."""
    if p >= OPEN_ABOVE:
        return PresenceState.OPEN
    return PresenceState.CLOSED if p < HOPELESS_BELOW else PresenceState.UNKNOWN


def observed_presence(
    timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None
) -> tuple[ObservedPresence, ...]:
    """Return what was observed of an edge up to an instant, oldest first; linear in what happened to it."""
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
    """Return how probably an edge was open at times in order, each by what was known then; later times are foretold.

    Linear in observations and times.
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
    """Return when a closed edge will be held to be open if nobody looks, None if it is so now or not in two weeks."""
    tracks = follow_histories(presence_filter, [[seen for seen in observations if seen.stamp_s <= now_s]])
    if tracks.probability(now_s)[0] >= OPEN_ABOVE:
        return None
    ahead_s = np.geomspace(1.0, _LONGEST_S, 200)
    for later_s in ahead_s:
        if tracks.probability(now_s + float(later_s))[0] >= OPEN_ABOVE:
            return now_s + float(later_s)
    return None


def presence_as_if(graph: TopologicalGraph, presence_filter: PresenceFilter, at_s: float) -> dict[EdgeKey, float]:
    """Return how probably all edges that were ever seen blocked are open at any time, by all that the map knows of it.

    Of a time before, only what was observed up to then counts.
    """
    histories = list(graph.presence.values())
    found = presence_probabilities(presence_filter, histories, at_s)
    return dict(zip(graph.presence, map(float, found), strict=True))


@dataclass(frozen=True, slots=True)
class PresenceChange:
    """An edge that is held for something else than before."""

    edge: EdgeKey
    before: float
    now: float


def presence_changes(
    graph: TopologicalGraph, presence_filter: PresenceFilter, since_s: float, now_s: float
) -> tuple[PresenceChange, ...]:
    """Return the edges that are held to be in another state now than at a time before, such as yesterday."""
    before, now = (presence_as_if(graph, presence_filter, at_s) for at_s in (since_s, now_s))
    return tuple(
        PresenceChange(edge, before[edge], now[edge])
        for edge in now
        if presence_state(before[edge]) is not presence_state(now[edge])
    )


MapAtTime: TypeAlias = tuple[TopologicalGraph, float]
"""A map, and a time on the clock of its world."""


def presence_difference(
    here: MapAtTime, there: MapAtTime, presence_filter: PresenceFilter, *, edges: Mapping[EdgeKey, EdgeKey]
) -> tuple[PresenceChange, ...]:
    """Return the edges of two maps that one holds for something else than the other, named as they are here.

    `edges` are those of both: of the map here to that there. What was never seen blocked is open.
    """
    now, before = (presence_as_if(graph, presence_filter, at_s) for graph, at_s in (here, there))
    known = {edge: other for edge, other in edges.items() if edge in now or other in before}
    changes = (PresenceChange(edge, before.get(other, 1.0), now.get(edge, 1.0)) for edge, other in known.items())
    return tuple(each for each in changes if presence_state(each.before) is not presence_state(each.now))
