"""Progress of a build through its stages: each counts as many images as its share of the time.

Owns these shares.
"""

import itertools
from collections.abc import Callable
from enum import Enum

from ltvn_core.config import Method

ProgressCallback = Callable[[int, int], None]
"""Called with the number of images done and the number of all images."""


class BuildStage(Enum):
    """A stage of a build, in order, with its share of the processor time, in drives of 2,500 and of 10,000 images
    through a building of 1,000 m2."""

    ENCODING = 0.1
    SLIPS = 0.02
    """Odometry is corrected for wheel slips."""
    CLOSURES = 0.15
    """Odometry is corrected by loop closures."""
    PASSES = 0.6
    """Images are merged with nodes, or become nodes."""
    FLOOR = 0.13
    """Edges over free floor are searched."""


class BuildProgress:
    """Tells how far a build is; never goes back."""

    def __init__(self, method: Method, count: int, tell: ProgressCallback | None) -> None:
        """Count the stages in which a method builds a map of some images."""
        left_out = {
            BuildStage.SLIPS: not method.matching.mend_slips,
            BuildStage.CLOSURES: not method.building.close_loops,
            BuildStage.FLOOR: not method.building.floor_edges,
        }
        shares = {stage: 0.0 if left_out.get(stage) else stage.value for stage in BuildStage}
        ends = list(itertools.accumulate(shares.values(), initial=0.0))
        self._parts = {stage: (ends[k] / ends[-1], shares[stage] / ends[-1]) for k, stage in enumerate(shares)}
        """Beginning and share of each stage."""
        self._count = count
        self._tell = tell
        self._done = 0

    def of(self, stage: BuildStage) -> Callable[[float], None]:
        """Return a function to call with the share of a stage that is done."""
        before, own = self._parts[stage]
        return lambda share: self._show(int(self._count * (before + own * share)))

    def end(self) -> None:
        """Tell that the map is built."""
        self._show(self._count)

    def _show(self, done: int) -> None:
        self._done = max(self._done, done)
        if self._tell is not None:
            self._tell(self._done, self._count)
