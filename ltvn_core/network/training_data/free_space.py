"""Interface of a scene's free space, for sampling and labelling training poses. A simulated scene implements it."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose


class FreeSpace(Protocol):
    """Free space of a scene: distances to obstacles and paths between them, for the centre of the robot."""

    def at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the distances (...) in metres from points (..., 2) to the nearest obstacle."""
        ...

    def along(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.float64]:
        """Return the smallest clearance (N,) on straight lines from starts (N, 2) to ends (N, 2)."""
        ...

    def sample_poses(self, rng: np.random.Generator, count: int, *, min_clearance_m: float = ...) -> Pose:
        """Draw free poses (count, 3)."""
        ...

    def path(self, start: ArrayLike, goal: ArrayLike) -> NDArray[np.float64] | None:
        """Return a path (M, 2) from start (2,) to goal (2,), or None if there is none."""
        ...

    def path_lengths(self, start: ArrayLike, goals: ArrayLike, *, limit_m: float = ...) -> NDArray[np.float64]:
        """Return the lengths (N,) in metres of the shortest paths from start (2,) to goals (N, 2); inf if none."""
        ...
