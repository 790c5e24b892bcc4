"""Pairs of images of a recorded drive, labelled from odometry.

Pairs are reachable, not reachable, or unknown because odometry drifts. This is the self-supervision of fine-tuning:
poses come from odometry and free space from depth; neither a map nor ground-truth poses are used.
"""

from dataclasses import dataclass, field
from math import radians
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.network.training_data.reachability_labels import (
    ReachabilityLimits,
    clearance_from_depth,
    in_view,
    overlap,
    straight_m,
    unobstructed,
)
from ltvn_core.network.training_data.trajectory import REACHABLE, UNKNOWN, UNREACHABLE, Trajectory
from ltvn_core.types import Waypoint

_PAIRS_AT_ONCE = 4096
_MOST_PAIRS = 80_000
"""Largest number of pairs of a drive; of more pairs, a random sample is used."""
_HELD_OUT_EVERY = 7
"""Every n-th section of the drive is held out for validation."""


class LabelRule(Protocol):
    """A rule that labels pairs of images of one drive."""

    @property
    def horizon(self) -> int:
        """Largest number of images between the ends of a pair that is labelled."""
        ...

    def labels(
        self,
        trajectory: Trajectory,
        sources: NDArray[np.integer],
        targets: NDArray[np.integer],
        rng: np.random.Generator,
    ) -> NDArray[np.int8]:
        """Return REACHABLE, UNREACHABLE or UNKNOWN (P,) for pairs at most `horizon` images apart."""
        ...

    def far(
        self, trajectory: Trajectory, sources: NDArray[np.integer], targets: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Return which pairs of rows (any shapes that broadcast) are certainly not reachable."""
        ...


@dataclass(frozen=True, slots=True)
class OdometryLabelRule:
    """Labels by order in time, checked with odometry and depth (`gated=False` is the paper's rule; rest: ours)."""

    horizon: int = 15
    """H: an image is reachable from the H images before it (section III-B)."""
    gated: bool = True
    """Whether to check odometry and depth as well. False labels a pair as reachable if 0 < j - i <= H, and as not
    reachable otherwise."""
    limits: ReachabilityLimits = field(default_factory=ReachabilityLimits)
    """Limits of the reachability criteria, the same as in simulation."""
    far_m: float = 3.0
    """Images with a larger distance are not reachable, after subtracting the possible drift."""
    far_rad: float = radians(92)
    """Images with a larger difference of heading are not reachable, after subtracting the possible drift."""
    drift: float = 0.05
    """Possible drift of the position, as a share of the metres driven in between."""
    drift_turn: float = 0.02
    """Possible drift of the heading, as a share of the radians turned in between."""
    overlap_margin: float = 0.1
    """A pair that misses the limit of overlap by less than this is unknown."""
    yaw_margin_rad: float = radians(6)
    """A pair that misses the limit of heading by less than this is unknown."""
    metres_margin: float = 0.15
    """A pair that misses the limit of distance by less than this is unknown."""

    def labels(
        self,
        trajectory: Trajectory,
        sources: NDArray[np.integer],
        targets: NDArray[np.integer],
        rng: np.random.Generator,
    ) -> NDArray[np.int8]:
        """Return the labels (P,) of pairs at most H images apart, over which drift is negligible; `rng` is not used.

        Pairs across a jump of odometry are unknown. So are pairs against the direction of driving that meet all
        criteria: the robot did not show that it can drive there.
        """
        together = trajectory.piece[sources] == trajectory.piece[targets]
        forward = together & (targets > sources) & (targets - sources <= self.horizon)
        if not self.gated:
            return np.where(forward, REACHABLE, UNREACHABLE).astype(np.int8)
        labels = np.full(len(sources), UNKNOWN, np.int8)
        for part in np.array_split(np.flatnonzero(together), max(len(sources) // _PAIRS_AT_ONCE, 1)):
            passed, failed = _passed_and_failed(trajectory, sources[part], targets[part], self)
            labels[part] = np.where(failed, UNREACHABLE, np.where(passed & forward[part], REACHABLE, UNKNOWN))
        return labels

    def far(
        self, trajectory: Trajectory, sources: NDArray[np.integer], targets: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Return which pairs of rows (any shapes that broadcast) are farther apart than drift can explain."""
        after = targets - sources
        together = trajectory.piece[sources] == trajectory.piece[targets]
        if not self.gated:
            return (after != 0) & ~(together & (after > 0) & (after <= self.horizon))
        shift = trajectory.poses[targets] - trajectory.poses[sources]
        driven = np.abs(trajectory.travelled_m[targets] - trajectory.travelled_m[sources])
        turned = np.abs(trajectory.turned_rad[targets] - trajectory.turned_rad[sources])
        away = np.hypot(shift[..., 0], shift[..., 1]) - self.drift * driven > self.far_m
        turn = np.abs(wrap_angle(shift[..., 2])) - self.drift_turn * turned > self.far_rad
        return together & (away | turn)


@dataclass(frozen=True, eq=False)
class TrajectoryPairs(Trajectory):
    """A drive with its labelled pairs, as training examples (`training_examples.SceneExamples`)."""

    rule: LabelRule
    sources: NDArray[np.int32]
    """(P,) rows of the source images of pairs at most H images apart whose label is known."""
    targets: NDArray[np.int32]
    """(P,) rows of the target images."""
    reachable: NDArray[np.bool_]
    """(P,) whether each pair is reachable."""

    @property
    def group(self) -> NDArray[np.int32]:
        """(N,) number of the section of the drive, each three horizons long."""
        return (np.arange(len(self.poses)) // (3 * self.rule.horizon)).astype(np.int32)

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """(N,) images that are kept for validation."""
        return self.group % _HELD_OUT_EVERY == _HELD_OUT_EVERY // 2

    def far(self, sources: NDArray[np.integer], targets: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which pairs of rows (S, T) are certainly not reachable, however odometry may have drifted."""
        return self.rule.far(self, sources[:, None], targets[None, :])


def label_trajectory(trajectory: Trajectory, rule: LabelRule, rng: np.random.Generator) -> TrajectoryPairs:
    """Return the pairs of a drive at most H images apart whose label is known."""
    count = len(trajectory.poses)
    horizon = rule.horizon
    sources = np.repeat(np.arange(count), 2 * horizon + 1)
    targets = sources + np.tile(np.arange(-horizon, horizon + 1), count)
    inside = (targets >= 0) & (targets < count) & (targets != sources)
    rows = np.flatnonzero(inside)
    if len(rows) > _MOST_PAIRS:
        rows = np.sort(rng.choice(rows, _MOST_PAIRS, replace=False))
    i = sources[rows]
    j = targets[rows]
    labels = rule.labels(trajectory, i, j, rng)
    known = labels != UNKNOWN
    return TrajectoryPairs(
        **vars(trajectory),
        rule=rule,
        sources=i[known].astype(np.int32),
        targets=j[known].astype(np.int32),
        reachable=labels[known] == REACHABLE,
    )


def _passed_and_failed(
    trajectory: Trajectory, sources: NDArray[np.integer], targets: NDArray[np.integer], rule: OdometryLabelRule
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which pairs (P,) meet every criterion, and which miss one by more than its margin."""
    limits = rule.limits
    camera = trajectory.camera
    waypoints = relative(trajectory.poses[sources], trajectory.poses[targets])
    here = trajectory.depth_mm[sources] / np.float32(1000)
    there = trajectory.depth_mm[targets] / np.float32(1000)
    straight = straight_m(waypoints)
    turn = np.abs(waypoints[:, 2])
    shared = overlap(waypoints, here, there, camera)
    free = clearance_from_depth(waypoints, here, camera)
    passed = (straight < limits.distance_m) & (turn < limits.yaw_rad) & (shared > limits.overlap)
    passed &= _visible(waypoints, here, trajectory, limits.occlusion_m, 0.0) | (straight < limits.at_place_m)
    passed &= free > limits.line_clearance_m
    margin = rule.metres_margin
    failed = (straight > limits.distance_m + margin) | (turn > limits.yaw_rad + rule.yaw_margin_rad)
    failed |= shared < limits.overlap - rule.overlap_margin
    hidden = ~_visible(waypoints, here, trajectory, limits.occlusion_m + margin, rule.yaw_margin_rad)
    failed |= hidden & (straight > limits.at_place_m + margin)
    return passed, failed


def _visible(
    waypoints: Waypoint, depth: NDArray[np.floating], trajectory: Trajectory, tolerance_m: float, beside_rad: float
) -> NDArray[np.bool_]:
    """Return whether the target's position is unobstructed and in view, or up to `beside_rad` beside the view."""
    camera = trajectory.camera
    clear = unobstructed(waypoints, depth, camera, tolerance_m=tolerance_m)
    return in_view(waypoints, camera, beside_rad=beside_rad) & clear
