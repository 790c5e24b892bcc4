"""Which message belongs to which: by the nearest stamp, within half a frame. Owns no clock."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike


def period_s(stamps: ArrayLike) -> float | None:
    """Return the usual time between two of N stamps in order, None where there are too few."""
    steps = np.diff(np.asarray(stamps, np.float64))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else None


def rate_hz(stamps: ArrayLike) -> float | None:
    """Return how many of N stamps in order there are in a second."""
    period = period_s(stamps)
    return None if period is None else 1 / period


def nearest(stamps: Sequence[float], others: Sequence[float], *, slack_s: float) -> list[int | None]:
    """Return for each stamp the place of the nearest among `others`; None where none is within half a frame.

    Both are in rising order. Half a frame is half of the usual time between two stamps, and at least `slack_s`.
    """
    if not len(others):
        return [None] * len(stamps)
    wanted = np.asarray(stamps, np.float64)
    offered = np.asarray(others, np.float64)
    after = np.clip(np.searchsorted(offered, wanted), 1, max(len(offered) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(offered) - 1)
    place = np.where(np.abs(offered[before] - wanted) <= np.abs(offered[after] - wanted), before, after)
    within = np.abs(offered[place] - wanted) <= max((period_s(wanted) or 0.0) / 2, slack_s)
    return [int(k) if ok else None for k, ok in zip(place, within, strict=True)]
