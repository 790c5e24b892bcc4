"""The clock of the world: its time at a moment of a run, and the text form of such times.

Presence is observed on this clock. It may differ from the robot's clock: in simulation, world time also passes between
queries. Owns parsing and formatting of times. Days count from 1.
"""

import math
import re
from dataclasses import dataclass
from typing import TypeAlias

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.errors import OptionError
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent, WorldChanged

DAY_S = 86400.0
_HOUR_S = 3600.0
_MINUTE_S = 60.0
_UNITS_S = {"s": 1.0, "min": _MINUTE_S, "h": _HOUR_S, "d": DAY_S}

_TIME_OF_DAY = re.compile(r"(?:at\s+)?(?:day\s+(\d+),?\s+)?(\d{1,2}):(\d{2})", re.IGNORECASE)
_WAIT = re.compile(r"in\s+(\d+(?:\.\d+)?)\s*(s|min|h|d)", re.IGNORECASE)
TIME_EXAMPLES = ("at 18:00", "at day 2 18:00", "in 30 min", "in 1 h")
"""One example of each form of a future time, for help texts."""


@dataclass(frozen=True, slots=True)
class TimeOfDay:
    """A time of day, in seconds after midnight, on day `day` (counted from 1); None for the present day."""

    seconds: float
    day: int | None = None


@dataclass(frozen=True, slots=True)
class TimeAway:
    """A time ahead of now, in seconds."""

    seconds: float


WorldTime: TypeAlias = TimeOfDay | TimeAway
"""A time as users write it."""


def world_time_at(timeline: Timeline, instant: Instant) -> float:
    """Return the time of the world at a moment of a run, in seconds since midnight of its first day.

    The last event with both times gives the offset of the two clocks; without one, the robot's clock is used. Linear in
    the events since then.
    """
    return _time_after(timeline, timeline.count_until(instant), instant.stamp)


def world_time_before(timeline: Timeline, event: int) -> float:
    """Return the time of the world just before event number `event`; costs as much as `world_time_at`."""
    return _time_after(timeline, event, timeline.instant(event - 1).stamp if event else timeline.start_s)


def _time_after(timeline: Timeline, count: int, stamp: float) -> float:
    for number in reversed(range(count)):
        told = _told_time(timeline.events[number])
        if told is not None:
            return told + max(0.0, stamp - timeline.instant(number).stamp)
    return stamp


def latest_known_time(graph: TopologicalGraph, now_s: float) -> float:
    """Return `now_s`, or the time of the map's latest observation if that is later, as in a map from a run with a later
    clock."""
    return max([now_s, *(seen[-1].stamp_s for seen in graph.presence.values())])


def _told_time(stamped: StampedEvent) -> float | None:
    match stamped.event:
        case WorldChanged(at_s=at_s):
            return at_s
        case GraphChanged(delta=PresenceObserved(stamp=seen_s, cause=cause)) if cause is not Cause.LOAD:
            return seen_s
        case _:
            return None


def parse_world_time(text: str) -> WorldTime:
    """Parse a time. Raises OptionError, which lists the valid forms, for anything else."""
    words = " ".join(text.split())
    if found := _TIME_OF_DAY.fullmatch(words):
        day, hours, minutes = found.groups()
        if int(hours) < 24 and int(minutes) < 60 and day != "0":
            seconds = int(hours) * _HOUR_S + int(minutes) * _MINUTE_S
            return TimeOfDay(seconds, None if day is None else int(day))
    elif found := _WAIT.fullmatch(words):
        return TimeAway(float(found[1]) * _UNITS_S[found[2].lower()])
    raise OptionError(
        f"{text[:60]!r} is not a time; write one of: {', '.join(TIME_EXAMPLES)}. Hours go to 23, days count from 1."
    )


def format_world_time(time: WorldTime) -> str:
    """Return the text of a time; parsing it gives the same time, if it is in whole minutes."""
    if isinstance(time, TimeOfDay):
        day = "" if time.day is None else f"day {time.day} "
        return f"at {day}{_hours_text(time.seconds)}"
    unit = next((unit for unit in ("d", "h", "min") if time.seconds and time.seconds % _UNITS_S[unit] == 0), "s")
    return f"in {time.seconds / _UNITS_S[unit]:g} {unit}"


def time_ahead(time: WorldTime, now_s: float) -> float:
    """Return the next occurrence of a time, in seconds of the world. Raises OptionError if it is in the past."""
    if isinstance(time, TimeAway):
        return now_s + time.seconds
    at_s = (math.floor(now_s / DAY_S) if time.day is None else time.day - 1) * DAY_S + time.seconds
    if time.day is None and at_s < now_s:
        at_s += DAY_S
    if at_s < now_s:
        raise OptionError(f"It is {clock_text(now_s)} already; imagine a later time, such as in 1 h.")
    return at_s


def clock_text(seconds: float) -> str:
    """Return a time of the world as text, such as "day 2, 18:00"; times outside the first 1,000 days are in seconds."""
    if seconds < 0 or seconds >= 1000 * DAY_S:  # The clock counts from another start, as on a real robot.
        return f"{seconds:.0f} s"
    return f"day {math.floor(seconds / DAY_S) + 1}, {_hours_text(seconds % DAY_S)}"


def duration_text(seconds: float) -> str:
    """Return a duration in a suitable unit, such as "20 min"."""
    if seconds < 2 * _MINUTE_S:
        return f"{seconds:.0f} s"
    if seconds < 2 * _HOUR_S:
        return f"{seconds / _MINUTE_S:.0f} min"
    return f"{seconds / _HOUR_S:.1f} h" if seconds < 2 * DAY_S else f"{seconds / DAY_S:.1f} days"


def _hours_text(seconds: float) -> str:
    minutes = math.floor(seconds / _MINUTE_S)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"
