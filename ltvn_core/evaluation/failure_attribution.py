"""What an episode's steps and touches are put down to.

Owns the bookkeeping. An episode is cut into turns, each from one localisation to the next; a turn goes wrong in at most
one way, the first of `CAUSE_ORDER`. What counts as going wrong is `evaluate.causes`.
"""

from collections import Counter
from dataclasses import dataclass, field

from ltvn_core.evaluation.results import FailureCause
from ltvn_core.types import FrameId

CAUSE_ORDER = (FailureCause.SPURIOUS_EDGE, FailureCause.MISLOCALISED, FailureCause.NO_PATH, FailureCause.COLLISION)
"""What goes wrong in one turn; each leads to those after it."""


@dataclass(slots=True)
class EpisodeSegment:
    """From one localisation to the next."""

    begin: FrameId
    """Step of the image."""
    causes: set[FailureCause] = field(default_factory=set)
    """All that went wrong in it."""
    collisions: int = 0

    @property
    def cause(self) -> FailureCause | None:
        """What went wrong first; None if all was well."""
        return next((cause for cause in CAUSE_ORDER if cause in self.causes), None)


class FailureAttribution:
    """Adds up turns."""

    def __init__(self) -> None:
        """Start with nothing to blame."""
        self._steps: Counter[FailureCause] = Counter()
        self._collisions: Counter[FailureCause] = Counter()

    def add(self, segment: EpisodeSegment, end: FrameId) -> None:
        """Put the steps and touches of a turn that is over at step `end` down to what went wrong in it.

        Touches in a turn in which all was well are the controller's own.
        """
        cause = segment.cause
        self._collisions[cause or FailureCause.COLLISION] += segment.collisions
        if cause is not None:
            self._steps[cause] += max(end - segment.begin, 0)

    @property
    def wasted_steps(self) -> int:
        """Steps of all turns that went wrong."""
        return self._steps.total()

    def main_waste_cause(self) -> FailureCause:
        """Return what wasted most steps; of equals the one that leads to the other."""
        return max(CAUSE_ORDER, key=lambda cause: self._steps[cause])

    def main_collision_cause(self) -> FailureCause:
        """Return what most touches were put down to; COLLISION of none."""
        return (
            max(CAUSE_ORDER, key=lambda cause: self._collisions[cause])
            if self._collisions.total()
            else FailureCause.COLLISION
        )
