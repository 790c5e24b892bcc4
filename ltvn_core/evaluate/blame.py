"""What an episode's steps and touches are put down to.

Owns the bookkeeping. An episode is cut into turns, each from one localisation to the next; a turn goes wrong in at most
one way, the first of `ORDER`. What counts as going wrong is `evaluate.causes`.
"""

from collections import Counter
from dataclasses import dataclass, field

from ltvn_core.evaluate.results import Failure
from ltvn_core.types import FrameId

ORDER = (Failure.SPURIOUS_EDGE, Failure.MISLOCALISED, Failure.NO_PATH, Failure.COLLISION)
"""What goes wrong in one turn; each leads to those after it."""


@dataclass(slots=True)
class Turn:
    """From one localisation to the next."""

    begin: FrameId
    """Step of the image."""
    causes: set[Failure] = field(default_factory=set)
    """All that went wrong in it."""
    touches: int = 0

    @property
    def cause(self) -> Failure | None:
        """What went wrong first; None if all was well."""
        return next((cause for cause in ORDER if cause in self.causes), None)


class Blame:
    """Adds up turns."""

    def __init__(self) -> None:
        """Start with nothing to blame."""
        self._steps: Counter[Failure] = Counter()
        self._touches: Counter[Failure] = Counter()

    def add(self, turn: Turn, end: FrameId) -> None:
        """Put the steps and touches of a turn that is over at step `end` down to what went wrong in it.

        Touches in a turn in which all was well are the controller's own.
        """
        cause = turn.cause
        self._touches[cause or Failure.COLLISION] += turn.touches
        if cause is not None:
            self._steps[cause] += max(end - turn.begin, 0)

    @property
    def wasted_steps(self) -> int:
        """Steps of all turns that went wrong."""
        return self._steps.total()

    def of_steps(self) -> Failure:
        """Return what wasted most steps; of equals the one that leads to the other."""
        return max(ORDER, key=lambda cause: self._steps[cause])

    def of_touches(self) -> Failure:
        """Return what most touches were put down to; COLLISION of none."""
        return max(ORDER, key=lambda cause: self._touches[cause]) if self._touches.total() else Failure.COLLISION
