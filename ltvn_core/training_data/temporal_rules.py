"""Labels from time alone, as the rivals SPTM and ViNG learn: what two images are to each other by the steps between.

Owns both rules, for random walks and for the robot's own drive alike. A step is an image of a drive: about 0.12 m or 10
degrees. A target that comes *before* its source by few steps is left out: whether the robot could drive there forwards
is not known. At run time each way of a pair is asked by itself, and a way back is driven in reverse, as in LTVN.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.training_data.trajectory import Trajectory
from ltvn_core.training_data.trajectory_pairs import REACHABLE, UNKNOWN, UNREACHABLE

TAU_STEPS = 8.0
"""ViNG's temporal distance d becomes r = exp(-d / tau), so that cross-entropy can learn it (ours)."""


@dataclass(frozen=True)
class TemporalLabelRule(ABC):
    """What the number of steps between two images says of them."""

    horizon: int = 40
    """Pairs up to so many steps apart are drawn one by one; ViNG's greatest distance d_max (ours)."""

    @property
    @abstractmethod
    def far_steps(self) -> int:
        """From so many steps on, images count as not reachable in either order."""

    @abstractmethod
    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets so many steps after their sources."""

    def labels(
        self,
        trajectory: Trajectory,
        sources: NDArray[np.integer],
        targets: NDArray[np.integer],
        rng: np.random.Generator,
    ) -> NDArray[np.int8]:
        """Return the labels (P,) of pairs of a drive; those across a jump of odometry are unknown: they lack a pose."""
        together = trajectory.piece[sources] == trajectory.piece[targets]
        return np.where(together, self.labels_by_steps(targets - sources, rng), UNKNOWN).astype(np.int8)

    def far(
        self, trajectory: Trajectory, sources: NDArray[np.integer], targets: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Tell which pairs of rows, of any shape that broadcasts, are far apart in time; a second visit is, too."""
        return np.abs(targets - sources) >= self.far_steps


@dataclass(frozen=True)
class TemporalClosenessRule(TemporalLabelRule):
    """SPTM: close in time or not; what lies in between is left out (both limits are SPTM's)."""

    near_steps: int = 5
    """Reachable is what comes up to so many steps later,"""
    margin: int = 5
    """and not reachable what is this many times as far away."""

    @property
    def far_steps(self) -> int:
        """Return the first step that counts as far."""
        return self.near_steps * self.margin

    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets so many steps after their sources."""
        near = (steps > 0) & (steps <= self.near_steps)
        far = np.abs(steps) >= self.far_steps
        return np.where(near, REACHABLE, np.where(far, UNREACHABLE, UNKNOWN)).astype(np.int8)


@dataclass(frozen=True)
class TemporalDistanceRule(TemporalLabelRule):
    """ViNG: the steps themselves. Each label is drawn with probability exp(-steps / tau), which r then learns."""

    tau: float = TAU_STEPS

    @property
    def far_steps(self) -> int:
        """Return d_max, at which the distance ends."""
        return self.horizon

    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets so many steps after their sources."""
        drawn = rng.random(len(steps)) < np.exp(-np.clip(steps, 0, self.horizon) / self.tau)
        forward = np.where(drawn, REACHABLE, UNREACHABLE)
        backward = np.where(steps <= -self.far_steps, UNREACHABLE, UNKNOWN)
        return np.where(steps > 0, forward, backward).astype(np.int8)


TEMPORAL_RULES: dict[str, TemporalLabelRule] = {"sptm": TemporalClosenessRule(), "ving": TemporalDistanceRule()}
"""The rule of each rival."""
