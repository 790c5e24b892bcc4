"""The filter of presence with constants for edges that a robot drives now and then.

The values are ours: a stay or an absence of an edge may be that of a person, of a piece of furniture or of a door, and
what is true of this one it must learn from a handful of observations.
"""

from ltvn_core.graph.presence.durations import DurationMixture
from ltvn_core.graph.presence.persistent import PersistentFilter, SightErrors

_MINUTE_S, _HOUR_S, _DAY_S = 60.0, 3600.0, 86400.0

EDGE_ERRORS = SightErrors(miss=0.005, false_alarm=0.005)
"""An obstruction is believed only where it lies across the way, and a success only at its end, so both rarely err."""

USUALLY_PRESENT = 0.9
"""Share of the time that an edge, of which nothing is known, can be driven."""

PERSISTENT = PersistentFilter(
    # What is seen to be closed once is mostly a door, which somebody opens and closes many times a day.
    present=DurationMixture.exponential([30 * _MINUTE_S, 6 * _HOUR_S, 7 * _DAY_S], [0.4, 0.3, 0.3]),
    # Somebody passes, a door is closed for a while, something is put down for long.
    absent=DurationMixture.exponential([15.0, 10 * _MINUTE_S, 5 * _HOUR_S], [0.25, 0.4, 0.35]),
    errors=EDGE_ERRORS,
    present_at_first=USUALLY_PRESENT,
)
