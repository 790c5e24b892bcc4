"""How long a lesson still takes, judged by what its parts took on this computer so far.

Owns what is known when: learning itself takes the time that was asked for. What comes before and after it does not, and
is known only by measuring; judging after takes about as long as judging before, and calibrating comes in between.
"""

import math
import time
from collections.abc import Callable

JUDGING, LEARNING, CALIBRATING = "judging the weights before", "learning", "calibrating"
"""What `ltvn_core.network.optimization.fine_tuning_loop` says that it is doing."""
_MOST = 2.0
"""Calibrating and judging after take at most so many times what judging before took."""


class LearningTime:
    """The parts of one lesson and when they began."""

    def __init__(self, minutes: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin a lesson that was asked to learn for `minutes`; `clock` counts seconds."""
        self._learning_s, self._clock = 60 * minutes, clock
        self._began = clock()
        self._parts: dict[str, float] = {}

    def hear(self, doing: str) -> None:
        """Take what is being done now."""
        self._parts.setdefault(doing, self._clock())

    @property
    def left(self) -> str:
        """How long it still takes, as a few words."""
        if LEARNING not in self._parts:
            return f"more than {_minutes(self._learning_s)} left"
        judging_s = self._parts[LEARNING] - self._parts.get(JUDGING, self._parts[LEARNING])
        now = self._clock()
        learning_s = max(0.0, self._learning_s - (now - self._parts[LEARNING]))
        judged_s = now - self._parts.get(CALIBRATING, now)
        least, most = (learning_s + max(0.0, share * judging_s - judged_s) for share in (1.0, _MOST))
        return _range(least, most)

    @property
    def besides_s(self) -> float | None:
        """Seconds that all but learning took, once learning is over; None before that."""
        return None if CALIBRATING not in self._parts else self._clock() - self._began - self._learning_s


def besides_words(besides_s: float | None) -> str:
    """Say how much longer than asked for a lesson takes."""
    if besides_s is None:
        return "Preparing and judging take minutes on top; how many, this page says once it has measured it."
    return f"Preparing and judging took {_minutes(max(besides_s, 1.0))} on top the last time."


def _range(least_s: float, most_s: float) -> str:
    low, high = math.ceil(least_s / 60), math.ceil(most_s / 60)
    if high <= 1:
        return "about a minute left"
    return f"about {high} min left" if low in (high, 0) else f"about {low} to {high} min left"


def _minutes(seconds: float) -> str:
    return f"{math.ceil(seconds / 60)} min"
