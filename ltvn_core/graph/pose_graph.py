"""A robust pose graph in the plane: the poses that best agree with a chain of odometry and uncertain loop closures.

Closures that contradict the rest lose all weight, by graduated non-convexity with truncated least squares (Yang,
Antonante, Tzoumas and Carlone, Graduated Non-Convexity for Robust Spatial Perception, RA-L 2020, eq. 14 and remark 5).
Owns the optimisation; closures come from `graph.drive_closures`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from ltvn_core.geometry import relative, wrap_angle
from ltvn_core.types import Pose, Waypoint

_TRUNCATED_ABOVE = 11.34
"""Squared error, in standard deviations, above which a closure counts as false; 99 % of the true ones stay below it."""
_GROWTH = 1.2
"""Factor by which the control parameter grows per round. Many rounds of one step find true closures that a few rounds
of three steps lose, in half the solves."""
_MOST_ROUNDS = 200
_LAST_STEPS = 10
_CONVERGED = 1e-4
_ROUGH, _EXACT, _MOST_ITERATIONS = 0.1, 1e-8, 30
"""Relative residuals at which conjugate gradients end, between rounds and in the last steps, and the largest number of
iterations. Each round solves another problem, so a rough step is enough until the last ones."""
_LONGEST_WAY = 1.5
"""Largest ratio of a true distance to the one that the wheels measured."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoses:
    """Measured relative poses of M pairs of poses."""

    first: NDArray[np.intp]
    """(M,) rows of the reference poses."""
    second: NDArray[np.intp]
    """(M,) rows of the poses that are measured."""
    poses: Waypoint
    """(M, 3): the second, seen from the first."""
    deviations: NDArray[np.float64]
    """(M, 3): standard deviations in m, m and rad."""
    shares: NDArray[np.float64] | float = 1.0
    """(M,) weight of each measurement, below 1 where several repeat the same evidence."""

    def among(self, rows: NDArray[np.bool_]) -> "RelativePoses":
        """Return the measurements of M that a mask (M,) selects."""
        shares = np.broadcast_to(self.shares, len(rows))[rows]
        return RelativePoses(self.first[rows], self.second[rows], self.poses[rows], self.deviations[rows], shares)

    def errors(self, poses: Pose) -> NDArray[np.float64]:
        """Return the errors (M, 3) of the pairs among poses (N, 3), in standard deviations."""
        gap = relative(poses[self.first], poses[self.second]) - self.poses
        gap[:, 2] = wrap_angle(gap[:, 2])
        return gap / self.deviations


class OptimisedPoses(NamedTuple):
    """The result of optimising a pose graph."""

    poses: Pose
    """(N, 3); the first stays where it was."""
    kept: NDArray[np.bool_]
    """(K,) whether each closure counts as true."""


def optimise(
    poses: Pose,
    odometry: RelativePoses,
    closures: RelativePoses,
    *,
    among: NDArray[np.bool_] | bool = True,
) -> OptimisedPoses:
    """Return the poses that agree best with odometry and the true closures, starting from a first guess (N, 3).

    Odometry must be a chain that joins all poses in order. A closure between places farther apart than the distance
    driven between them counts as false from the beginning, because one such closure would bend everything. Only
    closures in the mask `among` (K,) can count as true.
    """
    possible = _within_the_way(odometry, closures) & among
    closures = closures.among(possible)
    worst = _squared(closures.errors(poses)).max(initial=0.0)
    weights = np.ones(len(closures.first))
    control = _TRUNCATED_ABOVE / max(2 * worst - _TRUNCATED_ABOVE, _TRUNCATED_ABOVE)
    solver = _Solver()
    for _ in range(_MOST_ROUNDS):
        poses = _least_squares(poses, odometry, closures, weights, solver, most_steps=1, accuracy=_ROUGH)
        weights = _truncated_weights(_squared(closures.errors(poses)), control)
        if ((weights == 0) | (weights == 1)).all():
            break
        control *= _GROWTH
    true = (weights > 0.5).astype(float)
    poses = _least_squares(poses, odometry, closures, true, solver, most_steps=_LAST_STEPS)
    kept = possible.copy()
    kept[possible] = true > 0
    return OptimisedPoses(poses, kept)


def _within_the_way(odometry: RelativePoses, closures: RelativePoses) -> NDArray[np.bool_]:
    """Return a mask (K,) of the closures whose places are no farther apart than the driven distance allows."""
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(odometry.poses[:, 0], odometry.poses[:, 1]))])
    way_m = np.abs(driven_m[closures.first] - driven_m[closures.second])
    apart_m = np.hypot(closures.poses[:, 0], closures.poses[:, 1])
    slack_m = np.sqrt(_TRUNCATED_ABOVE) * np.hypot(closures.deviations[:, 0], closures.deviations[:, 1])
    return apart_m <= _LONGEST_WAY * way_m + slack_m


def _truncated_weights(squared: NDArray[np.float64], control: float) -> NDArray[np.float64]:
    """Return the weights (K,) of closures with these squared errors: 1 for small errors, 0 for large ones."""
    between = np.sqrt(_TRUNCATED_ABOVE * control * (control + 1) / np.maximum(squared, 1e-12)) - control
    sure = _TRUNCATED_ABOVE * control / (control + 1)
    lost = _TRUNCATED_ABOVE * (control + 1) / control
    return np.where(squared <= sure, 1.0, np.where(squared >= lost, 0.0, between))


def _least_squares(
    poses: Pose,
    odometry: RelativePoses,
    closures: RelativePoses,
    weights: NDArray[np.float64],
    solver: "_Solver",
    *,
    most_steps: int,
    accuracy: float = _EXACT,
) -> Pose:
    """Take Gauss-Newton steps, limited in number."""
    closures, weights = closures.among(weights > 0), weights[weights > 0]
    for _ in range(most_steps):
        driving, driving_errors = _linearised(poses, odometry, 1.0)
        closing, closing_errors = _linearised(poses, closures, weights)
        gradient = (driving.T @ driving_errors + closing.T @ closing_errors)[3:]
        step = solver.solve(_normal(driving, closing), -gradient, accuracy).reshape(-1, 3)
        poses = np.concatenate([poses[:1], poses[1:] + step])
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            break
    return poses


_ASKED, _ASKED_AT_ONCE = 200, 20
"""Largest number of poses whose deviations are computed; the others' are interpolated."""
_LEAST_REDUNDANCY = 12
"""Least number of measurements beyond those that a chain needs, from which the size of all errors is estimated."""


def deviations(poses: Pose, odometry: RelativePoses, closures: RelativePoses) -> NDArray[np.float64]:
    """Return the standard deviations (N, 2) of places and headings, in m and rad, seen from the first of the poses.

    From the inverse of the normal matrix at optimised poses (N, 3), times the variance that the errors left there show,
    if there are enough closures for that. All closures count as true; odometry must be a chain, as in `optimise`.
    """
    rows = np.unique(np.linspace(1, len(poses) - 1, min(_ASKED, len(poses) - 1)).astype(np.intp))
    driving, driving_errors = _linearised(poses, odometry, 1.0)
    closing, closing_errors = _linearised(poses, closures, 1.0)
    factors = _factors(_normal(driving, closing))
    parts = np.array_split(rows, -(-len(rows) // _ASKED_AT_ONCE))  # A column of the inverse is as long as the drive.
    variances = np.concatenate([_variances(factors, part) for part in parts])
    redundancy = 3.0 * np.broadcast_to(closures.shares, len(closures.first)).sum()
    if redundancy >= _LEAST_REDUNDANCY:
        variances *= sum(float(errors @ errors) for errors in (driving_errors, closing_errors)) / redundancy
    sizes = np.sqrt(np.stack([variances[:, :2].sum(axis=1), variances[:, 2]]))
    return np.stack([np.interp(np.arange(len(poses)), [0, *rows], [0.0, *each]) for each in sizes], axis=-1)


def _variances(factors: SuperLU, rows: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the variances (K, 3) of some poses in rows (K,) above 0, from the factors of the normal matrix."""
    columns = (3 * (rows[:, None] - 1) + np.arange(3)).ravel()
    unit = np.zeros((factors.shape[0], len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    return np.diagonal(factors.solve(unit)[columns]).reshape(-1, 3)


class _Solver:
    """Solves a sequence of similar linear systems.

    The factors of an earlier system precondition the next ones, until the systems differ too much.
    """

    def __init__(self) -> None:
        self._factors: SuperLU | None = None

    def solve(self, normal: csc_array, right: NDArray[np.float64], accuracy: float) -> NDArray[np.float64]:
        """Return x (N,) with `normal` (N, N) x = `right` (N,), up to a relative residual.

        `normal` must be symmetric and positive definite.
        """
        if self._factors is not None:
            like = LinearOperator(normal.shape, self._factors.solve)
            solution, failed = cg(normal, right, rtol=accuracy, maxiter=_MOST_ITERATIONS, M=like)
            if not failed:
                return solution
        factors = self._factors = _factors(normal)
        return factors.solve(right)


def _factors(normal: csc_array) -> SuperLU:
    """Return the factors of a symmetric, positive definite matrix."""
    # An ordering for symmetric matrices fills in far less than SuperLU's own choice, COLAMD.
    return splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _normal(first: csc_array, second: csc_array) -> csc_array:
    """Return the normal matrix (3 N - 3, 3 N - 3) of all poses but the first, which is fixed, from two Jacobians."""
    return csc_array((first.T @ first + second.T @ second)[3:, 3:])


def _linearised(
    poses: Pose, measured: RelativePoses, weights: NDArray[np.float64] | float
) -> tuple[csc_array, NDArray[np.float64]]:
    """Return the Jacobian (3 M, 3 N) of the weighted errors of M measurements by the poses (N, 3), and these errors
    (3 M,)."""
    count = len(measured.first)
    counting = np.broadcast_to(np.sqrt(weights * measured.shares), count)[:, None]
    scale = counting / measured.deviations
    here = poses[measured.first]
    there = poses[measured.second]
    cos = np.cos(here[:, 2])
    sin = np.sin(here[:, 2])
    zero = np.zeros(count)
    dx, dy = (there - here)[:, :2].T
    by_first = np.array([[-cos, -sin, cos * dy - sin * dx], [sin, -cos, -cos * dx - sin * dy], [zero, zero, zero - 1]])
    by_second = np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, zero + 1]])
    values = np.concatenate([each.transpose(2, 0, 1) * scale[:, :, None] for each in (by_first, by_second)])
    rows = np.broadcast_to(np.arange(3 * count).reshape(count, 3, 1), (count, 3, 3))
    ends = np.concatenate([measured.first, measured.second])[:, None, None]
    columns = np.broadcast_to(3 * ends + np.arange(3), (2 * count, 3, 3))
    places = np.concatenate([rows, rows]).ravel(), columns.ravel()
    jacobian = csc_array((values.ravel(), places), shape=(3 * count, 3 * len(poses)))
    return jacobian, (measured.errors(poses) * counting).ravel()


def _squared(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    return (errors**2).sum(axis=1)
