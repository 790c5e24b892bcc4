"""How often something happens, over the last second or so."""

from collections import deque
from collections.abc import Callable

WINDOW_S = 1.0


class RateMeter:
    """Counts events in a sliding window."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Measure by `clock`, in seconds."""
        self._clock = clock
        self._times: deque[float] = deque()

    def count(self) -> None:
        """Note one event, now."""
        now = self._clock()
        self._times.append(now)
        while self._times[0] < now - WINDOW_S:
            self._times.popleft()

    @property
    def hz(self) -> float:
        """Events per second lately; 0 before there are two."""
        if len(self._times) < 2:
            return 0.0
        return (len(self._times) - 1) / max(self._times[-1] - self._times[0], 1e-9)
