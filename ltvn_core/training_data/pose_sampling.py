"""Samples clusters of neighbouring poses for training; one image then serves in many pairs.

Needs the free space of a scene, but no camera.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose
from ltvn_core.training_data.scene_protocols import FreeSpace
from ltvn_core.types import Pose, Waypoint

_TRIES = 12
"""Proposals per pose; if none is free, the robot turns on the spot instead."""


@dataclass(frozen=True, slots=True)
class ClusterSampling:
    """Distribution of the poses of a cluster (all values are ours)."""

    size: int = 8
    """Poses per cluster; every ordered pair of them is labelled."""
    reach_m: float = 2.5
    """Distances to neighbours are uniform up to this."""
    from_anchor: float = 0.7
    """Share of neighbours drawn around the first pose rather than another one of the cluster."""
    ahead: float = 0.75
    """Share of neighbours drawn within the field of view; the others lie in any direction."""
    close: float = 0.2
    """Share of neighbours drawn within 0.6 m, as in a slow drive."""
    yaw_spread_rad: float = radians(26)
    """Standard deviation of the difference of headings between neighbours."""
    turned: float = 0.1
    """Share of neighbours with a uniform heading, often backwards: the same place, but not reachable."""
    min_clearance_m: float = 0.2
    """Least distance to obstacles."""


def cluster_poses(floor: FreeSpace, rng: np.random.Generator, count: int, spec: ClusterSampling) -> Pose:
    """Draw the poses (count, size, 3) of `count` clusters."""
    anchors = floor.sample_poses(rng, count, min_clearance_m=max(spec.min_clearance_m, 0.22))
    clusters = anchors[:, None]
    while clusters.shape[1] < spec.size:
        parents = np.where(rng.random(count) < spec.from_anchor, 0, rng.integers(clusters.shape[1], size=count))
        near = clusters[np.arange(count), np.asarray(parents, np.intp)]
        clusters = np.concatenate([clusters, _free_neighbours(floor, rng, near, spec)[:, None]], axis=1)
    return clusters


def cluster_pairs(count: int, size: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return sources and targets (count * size * (size - 1),): all ordered pairs within each cluster, in order."""
    first, second = np.nonzero(~np.eye(size, dtype=bool))
    offset = (np.arange(count) * size)[:, None]
    return (first + offset).ravel().astype(np.int32), (second + offset).ravel().astype(np.int32)


def _free_neighbours(floor: FreeSpace, rng: np.random.Generator, parents: Pose, spec: ClusterSampling) -> Pose:
    """Return one free pose (N, 3) beside each parent."""
    steps = _steps(rng, (len(parents), _TRIES), spec)
    proposals = compose(np.repeat(parents[:, None], _TRIES, axis=1), steps)
    free = floor.at(proposals[..., :2]) >= spec.min_clearance_m
    chosen = proposals[np.arange(len(parents)), free.argmax(1)]
    on_the_spot = compose(parents, steps[:, 0] * [0, 0, 1])
    return np.where(free.any(1, keepdims=True), chosen, on_the_spot)


def _steps(rng: np.random.Generator, shape: tuple[int, int], spec: ClusterSampling) -> Waypoint:
    """Draw waypoints (*shape, 3) to neighbours."""
    distance = rng.uniform(0, spec.reach_m, shape)
    distance *= np.where(rng.random(shape) < spec.close, 0.6 / spec.reach_m, 1.0)
    ahead = rng.random(shape) < spec.ahead
    bearing = np.where(ahead, rng.uniform(-0.6, 0.6, shape), rng.uniform(-np.pi, np.pi, shape))
    turn = rng.normal(0, spec.yaw_spread_rad, shape)
    turn = np.where(rng.random(shape) < spec.turned, rng.uniform(-np.pi, np.pi, shape), turn)
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing), turn], axis=-1)
