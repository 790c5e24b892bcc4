"""What is known of the presence of one thing: that it was there, or was not, at some moments."""

from typing import NamedTuple


class PresenceObservation(NamedTuple):
    """A thing was seen to be there, or not to be there."""

    present: bool
    stamp_s: float
    """Seconds on the clock of the world."""
