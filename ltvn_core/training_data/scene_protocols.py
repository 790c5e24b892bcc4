"""What data generation asks of a simulated world, as Protocols: a floor that knows its obstacles, and a camera."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose, Renderer


class FreeSpace(Protocol):
    """Distances to obstacles and ways around them, for the centre of the robot."""

    def at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the metres from points (..., 2) to the nearest obstacle; shape (...)."""
        ...

    def along(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.float64]:
        """Return the least clearance (N,) on straight lines from starts (N, 2) to ends (N, 2)."""
        ...

    def sample_poses(self, rng: np.random.Generator, count: int, *, min_clearance_m: float = ...) -> Pose:
        """Draw free poses (count, 3)."""
        ...

    def path(self, start: ArrayLike, goal: ArrayLike) -> NDArray[np.float64] | None:
        """Return points (M, 2) from start to goal, or None."""
        ...

    def path_lengths(self, start: ArrayLike, goals: ArrayLike, *, limit_m: float = ...) -> NDArray[np.float64]:
        """Return the metres (N,) of the shortest feasible ways from start (2,) to goals (N, 2); inf if none."""
        ...


@dataclass(frozen=True, eq=False)
class DatasetScene:
    """One scene, ready to be looked at."""

    name: str
    """Name of the scene; names its shard."""
    floor: FreeSpace
    """Where a robot can stand and go."""
    camera: Renderer
    """What it sees there."""


OpenDatasetScene: TypeAlias = Callable[[str], DatasetScene]
"""Opens a scene by name; the command line passes the simulator's."""
