"""Attributes the steps and collisions of an episode to causes.

An episode is divided into segments, each from one localisation to the next. A segment has at most one cause, the first
of `CAUSE_ORDER`. `failure_causes` decides which causes apply.
"""

from collections import Counter
from dataclasses import dataclass, field

from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.types import FrameId

CAUSE_ORDER = (FailureCause.SPURIOUS_EDGE, FailureCause.MISLOCALISED, FailureCause.NO_PATH, FailureCause.COLLISION)
"""Causes in causal order: each may lead to those after it."""


@dataclass(slots=True)
class EpisodeSegment:
    """The part of an episode from one localisation to the next."""

    begin: FrameId
    """Step of the image."""
    causes: set[FailureCause] = field(default_factory=set)
    """The causes that apply to it."""
    collisions: int = 0

    @property
    def cause(self) -> FailureCause | None:
        """The first cause in causal order; None if nothing went wrong."""
        return next((cause for cause in CAUSE_ORDER if cause in self.causes), None)


class FailureAttribution:
    """Sums over segments by cause."""

    def __init__(self) -> None:
        """Start with zero steps and collisions for each cause."""
        self._steps: Counter[FailureCause] = Counter()
        self._collisions: Counter[FailureCause] = Counter()

    def add(self, segment: EpisodeSegment, end: FrameId) -> None:
        """Attribute the steps and collisions of a segment that ended at step `end` to its cause.

        Collisions in a segment without a cause are attributed to the controller.
        """
        cause = segment.cause
        self._collisions[cause or FailureCause.COLLISION] += segment.collisions
        if cause is not None:
            self._steps[cause] += max(end - segment.begin, 0)

    @property
    def wasted_steps(self) -> int:
        """Steps of all segments with a cause."""
        return self._steps.total()

    def main_waste_cause(self) -> FailureCause:
        """Return the cause with most steps; of equal ones the first in causal order."""
        return max(CAUSE_ORDER, key=lambda cause: self._steps[cause])

    def main_collision_cause(self) -> FailureCause:
        """Return the cause with most collisions; COLLISION if there are none."""
        return (
            max(CAUSE_ORDER, key=lambda cause: self._collisions[cause])
            if self._collisions.total()
            else FailureCause.COLLISION
        )
