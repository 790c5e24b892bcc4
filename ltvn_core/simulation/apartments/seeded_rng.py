"""Random draws that are bit-identical on every machine, for scene generation.

All draws are computed from doubles in [0, 1) with exact arithmetic. Neither numpy's distributions nor transcendental
functions are used, because their last bit may differ between processors and versions, and a single bit can change the
generated apartment.
"""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


class SeededRng:
    """Draws numbers, items and orders from one generator; each draw depends on all draws before it."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def uniform(self, low: float, high: float) -> float:
        """Draw a number in [low, high)."""
        return low + (high - low) * float(self._rng.random())

    def uniform_multiple(self, low: float, high: float, step: float = 0.05) -> float:
        """Draw a multiple of `step` between low and high; without one, return `low` rounded up to a multiple."""
        first = int(np.ceil(low / step - 1e-6))
        last = int(np.floor(high / step + 1e-6))
        return round((first + self.index(max(last - first, 0) + 1)) * step, 6)

    def index(self, count: int) -> int:
        """Draw an integer in [0, count)."""
        return min(int(self._rng.random() * count), count - 1)

    def choice(self, items: Sequence[T]) -> T:
        """Draw one item."""
        return items[self.index(len(items))]

    def chance(self, probability: float) -> bool:
        """Return True with a probability."""
        return float(self._rng.random()) < probability

    def shuffled(self, items: Sequence[T]) -> list[T]:
        """Return the items in random order."""
        keys = self._rng.random(len(items))
        return [items[i] for i in np.argsort(keys, kind="stable")]

    def uniform_array(self, *shape: int) -> NDArray[np.float64]:
        """Draw an array of numbers in [0, 1)."""
        return self._rng.random(shape)

    def spawn(self) -> "SeededRng":
        """Return an independent generator, so that the number of draws in one room does not change the next room."""
        return SeededRng(np.random.default_rng(int(self._rng.random() * 2**53)))
