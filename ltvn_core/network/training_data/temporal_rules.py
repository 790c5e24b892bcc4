"""Labels pairs by the number of steps between their images, as the baselines SPTM and ViNG do.

A step is from one image of a random walk or drive to the next: about 0.12 m or 10 degrees. A target a few steps
*before* its source has no label, because it is unknown whether the robot could drive there forwards.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.network.training_data.trajectory import REACHABLE, UNKNOWN, UNREACHABLE, Trajectory

TAU_STEPS = 8.0
"""Scale tau, in steps, that converts ViNG's temporal distance d to r = exp(-d / tau), so that it can be learned with
cross-entropy (ours). ViNG's map converts r back with the same tau."""


@dataclass(frozen=True)
class TemporalLabelRule(ABC):
    """Labels a pair by the number of steps from its source to its target."""

    horizon: int = 40
    """Largest number of steps between the images of a labelled pair; ViNG's largest distance d_max (value: ours)."""

    @property
    @abstractmethod
    def far_steps(self) -> int:
        """Number of steps from which on images count as not reachable in either direction."""

    @abstractmethod
    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets at the given numbers of steps (P,) after their sources."""

    def labels(
        self,
        trajectory: Trajectory,
        sources: NDArray[np.integer],
        targets: NDArray[np.integer],
        rng: np.random.Generator,
    ) -> NDArray[np.int8]:
        """Return the labels (P,) of pairs of a drive; pairs across a jump of odometry are UNKNOWN."""
        together = trajectory.piece[sources] == trajectory.piece[targets]
        return np.where(together, self.labels_by_steps(targets - sources, rng), UNKNOWN).astype(np.int8)

    def far(
        self, trajectory: Trajectory, sources: NDArray[np.integer], targets: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Return which pairs of rows (any shapes that broadcast) are far apart in time, even at the same place."""
        return np.abs(targets - sources) >= self.far_steps


@dataclass(frozen=True)
class TemporalClosenessRule(TemporalLabelRule):
    """SPTM's labels: close in time or not; pairs in between have no label (both limits are SPTM's)."""

    near_steps: int = 5
    """Largest number of steps after its source at which a target is reachable."""
    margin: int = 5
    """Multiple of `near_steps` from which on a target is not reachable."""

    @property
    def far_steps(self) -> int:
        """Number of steps from which on pairs count as far."""
        return self.near_steps * self.margin

    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets at the given numbers of steps (P,) after their sources."""
        near = (steps > 0) & (steps <= self.near_steps)
        far = np.abs(steps) >= self.far_steps
        return np.where(near, REACHABLE, np.where(far, UNREACHABLE, UNKNOWN)).astype(np.int8)


@dataclass(frozen=True)
class TemporalDistanceRule(TemporalLabelRule):
    """ViNG's labels: the number of steps itself.

    Each label is drawn as reachable with probability exp(-steps / tau), so that r learns this probability.
    """

    tau: float = TAU_STEPS

    @property
    def far_steps(self) -> int:
        """ViNG's d_max, at which the distance saturates."""
        return self.horizon

    def labels_by_steps(self, steps: NDArray[np.integer], rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels (P,) of targets at the given numbers of steps (P,) after their sources."""
        drawn = rng.random(len(steps)) < np.exp(-np.clip(steps, 0, self.horizon) / self.tau)
        forward = np.where(drawn, REACHABLE, UNREACHABLE)
        backward = np.where(steps <= -self.far_steps, UNREACHABLE, UNKNOWN)
        return np.where(steps > 0, forward, backward).astype(np.int8)
