"""The odometry gate: how far apart two images of one trajectory can be, allowing for drift.

Owns that allowance. Odometry is evidence against false edges between perceptual aliases, and saves comparing images
that cannot be near. It joins nodes only in `graph.bridges` and `graph.floor_edges`. Across a jump of odometry, as
after a restart, and between two drives, relative poses are known only through links, unless one drive continues the
odometry of the other (`maps.joined_drives`). A drive whose odometry never moves counts as a drive without odometry.
"""

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from ltvn_core.config import BuildingConfig
from ltvn_core.geometry import compose, invert, relative, wrap_angle
from ltvn_core.graph.matching import Matches
from ltvn_core.types import FrameId, NodeId, Observation, Pose, Waypoint

JUMP_M = 1.5
"""Distance between consecutive images above which odometry jumped, in metres."""
_SLACK_M, _SLACK_RAD = 0.6, 0.6
"""Largest error of the predictor's waypoint, in m and rad."""
PAUSE_S = 5.0
"""Least pause between two images, in seconds, in which somebody may have carried the robot without its odometry
noticing."""
_DRIFT_RAD_PER_M = 0.02
_STEP_M = 0.05
"""Length that a closure adds to a path along the drive, in metres."""
_ROUNDING = 1e-3
"""Differences between the two directions of a pair, in metres: paths between closures have single precision."""
_OTHER_LINK = 3.0
"""Factor of the allowance within which two links agree on a pose: each may be wrong by the allowance."""
_MOST_ROWS_REMEMBERED, _MOST_BYTES_REMEMBERED = 2**25, 2**28
"""Number of near images that a gate remembers, and memory for the ways between its closures. Beyond it they are
computed again, because a gate in which too little is certain would need memory for all pairs."""


@dataclass(frozen=True, slots=True, eq=False)
class DriveLink:
    """Two images that surely show one place, in one stretch of odometry or in two."""

    frame: FrameId
    other: FrameId
    waypoint: Waypoint
    """(3,) pose of the second image in the frame of the first."""


class OdometryGate:
    """Odometry along one or several trajectories, as a test of which images can be near each other."""

    def __init__(
        self,
        observations: Sequence[Observation],
        config: BuildingConfig,
        *,
        drive_starts: Collection[FrameId] = (),
        resumed: Collection[FrameId] = (),
        links: Sequence[DriveLink] | None = None,
        closures: Sequence[DriveLink] = (),
    ) -> None:
        """Use N images; their rows are in the order of their frames.

        If odometry was corrected by `closures`, drift grows along the shortest path, on which a closure is a step.

        Images of two linked stretches must fit the link that is nearest along the path. If links were searched, images
        of two drives without a link count as taken at different places; `links` is None if no search was made. A drive
        whose odometry does not move gives no evidence. Odometry restarts at `drive_starts`. `resumed` are the first
        frames of drives that continue the odometry of the drive before; the pause before such a frame is ignored,
        because it was judged already.
        """
        ordered = sorted(observations, key=lambda seen: seen.step)
        self._row = {seen.step: k for k, seen in enumerate(ordered)}
        self.poses: Pose = np.array([seen.odometry for seen in ordered])
        """(N, 3) by odometry, each in the odometry frame of its stretch."""
        steps_m = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        self.along_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        """(N,) distance driven before each image, in metres."""
        frames = np.array([seen.step for seen in ordered])
        self._drive = np.searchsorted(np.sort([*drive_starts]), frames, side="right")
        self._moves = np.zeros(len(ordered), bool)
        """(N,) whether each image belongs to a drive whose odometry changes."""
        for number in np.unique(self._drive):
            own = self._drive == number
            self._moves[own] = bool(np.ptp(self.poses[own], axis=0).any())
        breaks = (steps_m > JUMP_M) | ~self._moves[1:] | (np.diff(self._drive) > 0)
        self.stretch = np.concatenate([[0], np.cumsum(breaks)])
        """(N,) number of the stretch of unbroken odometry to which each image belongs."""
        self._ways = _ShortestWays(self.along_m, [(self._row[each.frame], self._row[each.other]) for each in closures])
        self._use_links(links)
        stamps_s = np.array([seen.stamp for seen in ordered])
        self._pauses = np.abs(np.diff(stamps_s)) > PAUSE_S
        begun = np.searchsorted(frames, sorted(resumed))
        self._pauses[begun[(begun > 0) & (begun < len(frames))] - 1] = False
        self._config = config

    def linked(self, links: Sequence[DriveLink]) -> Self:
        """Return the gate of the same images with other links."""
        gate = copy(self)
        gate._use_links(links)
        return gate

    def _use_links(self, links: Sequence[DriveLink] | None) -> None:
        """Use links in both directions, L of them; `links` is None if no search was made."""
        self._separates = links is not None
        links = links or ()
        ends = np.array([self.rows([link.frame, link.other]) for link in links], np.intp).reshape(-1, 2)
        steps = np.array([link.waypoint for link in links], np.float64).reshape(-1, 3)
        self._links = np.concatenate([ends, ends[:, ::-1]])
        """(L, 2) rows of the images at which links begin and end."""
        self._link_steps: Waypoint = np.concatenate([steps, invert(steps)])
        """(L, 3) poses of the second images in the frames of the first."""
        self._near: dict[int, NDArray[np.int32]] = {}
        self._remembered = 0

    def near_rows(self, row: int) -> NDArray[np.int32]:
        """Return the rows (K,), in order, of all images that could be within D_c or D_m of the image in a row, itself
        included, and of a few others: `may_be_near` excludes those."""
        rows = np.arange(len(self.poses))
        if not self._config.odometry_drift:
            return rows.astype(np.int32)
        if row not in self._near:
            if self._remembered > _MOST_ROWS_REMEMBERED:
                self._near.clear()
                self._remembered = 0
            driven, path_m = self._way(row, rows)
            # Another link may give another relative pose of such an image, or give it from the other side.
            factor = np.where(self.stretch == self.stretch[row], 1.0, _OTHER_LINK)
            allowed_m = self._reach_m + factor * self._allowance_m(path_m)
            near = np.hypot(driven[:, 0], driven[:, 1]) - _ROUNDING <= allowed_m
            self._near[row] = rows[near].astype(np.int32)
            self._remembered += len(self._near[row])
        return self._near[row]

    def may_be_near(self, frame: FrameId, nodes: Sequence[NodeId]) -> tuple[NodeId, ...]:
        """Return the nodes that could be within D_c or D_m of a frame, all of them if odometry is not used."""
        if not nodes or not self._config.odometry_drift:
            return tuple(nodes)
        driven, path_m = self._way(self._row[frame], self.rows(nodes))
        near = np.hypot(driven[:, 0], driven[:, 1]) <= self._reach_m + self._allowance_m(path_m)
        # d is at least sqrt(2) per radian, so an image that is turned far enough is too far away as well.
        near &= np.abs(wrap_angle(driven[:, 2])) <= self._reach_m / np.sqrt(2) + self._allowance_rad(path_m)
        return tuple(node for node, is_near in zip(nodes, near, strict=True) if is_near)

    def plausible(self, frame: FrameId, matches: Matches) -> NDArray[np.bool_]:
        """Tell for each match (N,) whether odometry allows its waypoint."""
        if not len(matches) or not self._config.odometry_drift:
            return np.ones(len(matches), bool)
        driven, path_m = self._way(self._row[frame], self.rows(matches.nodes))
        gap_m = np.hypot(*(driven - matches.waypoints)[:, :2].T)
        gap_rad = np.abs(wrap_angle(driven[:, 2] - matches.waypoints[:, 2]))
        return (gap_m <= self._allowance_m(path_m)) & (gap_rad <= self._allowance_rad(path_m))

    def allows(self, link: DriveLink) -> bool:
        """Tell whether odometry allows a link."""
        return bool(self.plausible(link.frame, Matches.of_one(link.other, 1.0, link.waypoint)).all())

    def driven(self, frame: FrameId, other: FrameId) -> Waypoint | None:
        """Return the pose (3,) of an image seen from another, by odometry alone.

        None if odometry is not used, if it jumps between the two, or if a pause between them makes it uncertain.
        """
        here, there = self._row[frame], self._row[other]
        is_broken = self.stretch[here] != self.stretch[there] or self._pauses[min(here, there) : max(here, there)].any()
        if is_broken or not self._config.odometry_drift:
            return None
        return relative(self.poses[here], self.poses[there])

    def rows(self, frames: Sequence[FrameId]) -> NDArray[np.intp]:
        """Return the rows (N,) of images, by which `seen_from` finds them."""
        return np.array([self._row[frame] for frame in frames], np.intp)

    def seen_from(self, frame: FrameId, rows: NDArray[np.intp]) -> tuple[Waypoint, NDArray[np.float64]]:
        """Return the poses (N, 3) of the images in some rows (N,), seen from a frame, and the lengths (N,) in metres of
        the odometry paths to them.

        A length is infinite if the pose is unknown.
        """
        driven, path_m = self._way(self._row[frame], rows)
        return driven, np.where(np.isneginf(path_m), np.inf, path_m)

    def knows(self, frame: FrameId, other: FrameId) -> bool:
        """Tell whether odometry and links together give the relative pose of two images."""
        _, path_m = self._way(self._row[frame], self.rows([other]))
        return bool(np.isfinite(path_m[0]))

    def _way(self, here: int, there: NDArray[np.intp]) -> tuple[Waypoint, NDArray[np.float64]]:
        """Return the poses (N, 3) of the images in rows `there`, seen from that in row `here`, and the lengths (N,) in
        metres of the odometry paths to them.

        A length is infinite if the pose is unknown, and -infinite if the two count as different places.
        """
        driven = relative(self.poses[here], self.poses[there])
        same = self.stretch[there] == self.stretch[here]
        apart = self._separates & (self._drive[there] != self._drive[here]) & self._moves[there] & self._moves[here]
        path_m = np.where(same, self._ways.between(np.array([here]), there)[0], np.where(apart, -np.inf, np.inf))
        from_here = np.flatnonzero(self.stretch[self._links[:, 0]] == self.stretch[here])
        if not len(from_here) or same.all():
            return driven, path_m
        near, far = self._links[from_here].T
        other = np.flatnonzero(~same)
        lengths = self._ways.between(np.array([here]), near).T + self._ways.between(far, there[other])
        lengths[self.stretch[far][:, None] != self.stretch[there[other]]] = np.inf
        best = lengths.argmin(axis=0)
        linked = np.isfinite(lengths[best, np.arange(len(other))])
        best = best[linked]
        other = other[linked]
        to_far = compose(relative(self.poses[here], self.poses[near]), self._link_steps[from_here])
        driven[other] = compose(to_far[best], relative(self.poses[far[best]], self.poses[there[other]]))
        path_m[other] = lengths[best, np.flatnonzero(linked)]
        return driven, path_m

    @property
    def _reach_m(self) -> float:
        return max(self._config.connect_distance, self._config.merge_distance)

    def _allowance_m(self, path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return _SLACK_M + self._config.odometry_drift * path_m

    @staticmethod
    def _allowance_rad(path_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return _SLACK_RAD + _DRIFT_RAD_PER_M * path_m


class _ShortestWays:
    """Lengths of the shortest paths along a drive, where closures are steps from one pass to another."""

    def __init__(self, path_m: NDArray[np.float64], closures: Sequence[tuple[int, int]]) -> None:
        """Use the distance (N,) driven before each image, in metres, and the rows of the images that closures join."""
        self._path_m = path_m
        self._ends = np.unique(np.array([row for pair in closures for row in pair], np.intp))
        if not len(self._ends):
            return
        pairs = np.searchsorted(self._ends, np.array(closures))
        chain = np.arange(len(self._ends) - 1)
        first = np.concatenate([chain, pairs[:, 0]])
        second = np.concatenate([chain + 1, pairs[:, 1]])
        lengths = np.concatenate([np.diff(path_m[self._ends]), np.zeros(len(pairs))])
        lengths = np.maximum(lengths, _STEP_M)  # A sparse graph would treat a length of zero as a missing edge.
        self._steps = csr_array(coo_array((lengths, (first, second)), shape=(len(self._ends), len(self._ends))))
        self._from_end: dict[int, NDArray[np.float32]] = {}
        after = np.minimum(np.searchsorted(self._ends, np.arange(len(path_m))), len(self._ends) - 1)
        self._beside = [(k, np.abs(path_m[self._ends[k]] - path_m)) for k in (np.maximum(after - 1, 0), after)]
        """The nearest closures (N,) before and after each row, and the distances (N,) to them in metres."""

    def between(self, here: NDArray[np.intp], there: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the lengths (L, M) of the shortest paths from rows (L,) to others (M,), in metres."""
        shortest = np.abs(self._path_m[there] - self._path_m[here][:, None])
        if not len(self._ends):
            return shortest
        for own, to_m in self._beside:
            onward = np.stack([self._ways_from(end) for end in own[here].tolist()])
            for far, from_m in self._beside:
                np.minimum(shortest, to_m[here, None] + onward[:, far[there]] + from_m[there], out=shortest)
        return shortest

    def _ways_from(self, end: int) -> NDArray[np.float32]:
        if end not in self._from_end:
            if len(self._from_end) * len(self._ends) * 4 > _MOST_BYTES_REMEMBERED:
                del self._from_end[next(iter(self._from_end))]
            self._from_end[end] = dijkstra(self._steps, directed=False, indices=end).astype(np.float32)
        return self._from_end[end]


class Newcomers:
    """The images that enter a part of a map one after the other, by their rows in the gate, and who met whom.

    Two images that odometry places far apart never meet, so meeting costs as much as there are images nearby.
    """

    def __init__(self, gate: OdometryGate, waiting: NDArray[np.bool_]) -> None:
        """Start empty; `waiting` (N,) becomes true for each image to which a newcomer may be near, until they meet."""
        self._gate = gate
        self._waiting = waiting
        self._number = np.zeros(len(waiting), np.intp)
        """(N,) 1 for the first newcomer, 2 for the second; 0 for images outside."""
        self._met = np.zeros(len(waiting), np.intp)
        """(N,) number of the last newcomer that each image met, or was too far away from to meet."""
        self._last = 0

    def enter(self, row: int) -> None:
        """Let an image in."""
        self._last += 1
        self._number[row] = self._last
        self._waiting[self._gate.near_rows(row)] = True

    def leave(self, row: int) -> None:
        """Let an image out."""
        self._number[row] = 0

    def met_by(self, row: int) -> NDArray[np.int32]:
        """Return the images (K,) inside, in the order in which they came, that an image meets now for the first time.

        Images that are surely too far away are left out.
        """
        near = self._gate.near_rows(row)
        fresh = near[self._number[near] > self._met[row]]
        self._met[row] = self._last
        self._waiting[row] = False
        return fresh[np.argsort(self._number[fresh])]
