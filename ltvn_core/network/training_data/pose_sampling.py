"""Samples the poses of training images: clusters of neighbouring poses, pairs across clusters, and whole drives.

The mounting and the field of view of the camera vary between clusters, because a network trained with one mounting
depends on its exact height and pitch. Pairs across clusters are candidates for hard negatives of four kinds: pairs
close by (many behind walls or round corners), perceptual aliases, opposite views of one place, and random pairs. Their
labels are computed later, and some are reachable.

Drives have no physics: poses along clear paths between random places, with full turns. All ordered image pairs of a
drive are classified as near, far or neither, to count false positives.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import compose, lengths_along, points_along, relative, wrap_angle
from ltvn_core.network.training_data.reachability_labels import FreeSpace
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Pose, Renderer


@dataclass(frozen=True, eq=False)
class DatasetScene:
    """One scene of a dataset with its free space and renderer."""

    name: str
    """Name of the scene and of its shard."""
    floor: FreeSpace
    """Free space in which a robot can stand and drive."""
    camera: Renderer
    """Renderer of the images."""


OpenDatasetScene: TypeAlias = Callable[[str], DatasetScene]
"""Opens a scene by name; the command line passes the simulator's."""


_TRIES = 12
"""Number of proposals per pose; if none is free, the robot turns on the spot instead."""


@dataclass(frozen=True, slots=True)
class ClusterSampling:
    """Distribution of the poses of a cluster (all values are ours)."""

    size: int = 8
    """Number of poses per cluster; every ordered pair of them is labelled."""
    reach_m: float = 2.5
    """Largest distance to a neighbour, in metres; distances are uniform up to it."""
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
    """Least distance to obstacles, in metres."""


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
    shape = len(parents), _TRIES
    distance = rng.uniform(0, spec.reach_m, shape)
    distance *= np.where(rng.random(shape) < spec.close, 0.6 / spec.reach_m, 1.0)
    ahead = rng.random(shape) < spec.ahead
    bearing = np.where(ahead, rng.uniform(-0.6, 0.6, shape), rng.uniform(-np.pi, np.pi, shape))
    turn = rng.normal(0, spec.yaw_spread_rad, shape)
    turn = np.where(rng.random(shape) < spec.turned, rng.uniform(-np.pi, np.pi, shape), turn)
    steps = np.stack([distance * np.cos(bearing), distance * np.sin(bearing), turn], axis=-1)
    proposals = compose(np.repeat(parents[:, None], _TRIES, axis=1), steps)
    free = floor.at(proposals[..., :2]) >= spec.min_clearance_m
    chosen = proposals[np.arange(len(parents)), free.argmax(1)]
    on_the_spot = compose(parents, steps[:, 0] * [0, 0, 1])
    return np.where(free.any(1, keepdims=True), chosen, on_the_spot)


@dataclass(frozen=True, slots=True)
class CameraVariation:
    """Ranges of the variation of camera mounting and field of view (all values are ours)."""

    share: float = 0.3
    """Share of the clusters with a camera other than the nominal one."""
    height_m: float = 0.08
    """Largest difference of the camera's height from the nominal one, in metres."""
    pitch_rad: float = radians(4)
    """Largest difference of the camera's pitch from the nominal one, in radians."""
    fov: float = 0.05
    """Largest difference of the field of view from the nominal one, as a share."""

    def draw(self, rng: np.random.Generator, count: int) -> list[CameraModel]:
        """Return a camera for each of `count` clusters."""
        nominal = LOCOBOT.camera
        off = rng.uniform(-1, 1, (count, 3)) * (rng.random((count, 1)) < self.share)
        return [
            CameraModel.from_fov(
                nominal.width,
                nominal.height,
                nominal.horizontal_fov_rad * (1 + self.fov * fov),
                height_m=nominal.height_m + self.height_m * height,
                pitch_rad=self.pitch_rad * pitch,
            )
            for height, pitch, fov in off.tolist()
        ]


NEAR_M = 3.0
"""Largest distance between neighbours, even with a wall between them, in metres."""

BEHIND_M = 1.0
"""Largest distance between opposite views of one place, in metres."""

OPPOSITE_RAD = np.radians(120)
"""Smallest difference between opposite headings, in radians."""

_ALIAS_CANDIDATES = 5
"""Number of the most similar far images from which a perceptual alias is drawn."""

_CELL_PX = 12
"""Side in pixels of the squares whose mean colour and central depth form the descriptor of an image."""

PairRows = tuple[NDArray[np.int32], NDArray[np.int32]]
"""Sources and targets (P,), rows of the images."""


def hard_negative_pairs(
    rng: np.random.Generator,
    poses: Pose,
    group: NDArray[np.integer],
    rgb: NDArray[np.uint8],
    depth_mm: NDArray[np.uint16],
    count: int,
) -> PairRows:
    """Draw about `count` ordered pairs of images from different clusters, a quarter of each kind.

    Args:
        rng: Draws the pairs.
        poses: (N, 3) poses of the images.
        group: (N,) cluster of each image.
        rgb: (N, H, W, 3) colours.
        depth_mm: (N, H, W) depth in millimetres.
        count: Number of pairs; fewer are returned where duplicates are drawn.
    """
    if count == 0 or group.max() == group.min():
        return np.empty(0, np.int32), np.empty(0, np.int32)
    share = count // 4
    kinds = [
        _across_clusters(rng, poses, group, share, within_m=NEAR_M),  # Many are behind walls and round corners.
        _perceptual_aliases(rng, poses, group, appearance_descriptors(rgb, depth_mm), share),
        _across_clusters(rng, poses, group, share, within_m=BEHIND_M, least_turn_rad=OPPOSITE_RAD),
    ]
    left = count - sum(len(kind) for kind in kinds)
    drawn = rng.integers(len(group), size=(2 * left, 2))  # Twice as many, because some lie within one cluster.
    kinds.append(drawn[group[drawn[:, 0]] != group[drawn[:, 1]]][:left])
    pairs = np.unique(np.concatenate(kinds), axis=0)
    return pairs[:, 0].astype(np.int32), pairs[:, 1].astype(np.int32)


def appearance_descriptors(rgb: NDArray[np.uint8], depth_mm: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return descriptors (N, F): coarse colours and inverse depths of images (N, H, W, 3) and (N, H, W)."""
    count, height, width = depth_mm.shape
    rows = height // _CELL_PX
    columns = width // _CELL_PX
    cells = rgb[:, : rows * _CELL_PX, : columns * _CELL_PX].reshape(count, rows, _CELL_PX, columns, _CELL_PX, 3)
    colours = cells.mean((2, 4), dtype=np.float32).reshape(count, -1) / 255
    middle = depth_mm[:, _CELL_PX // 2 :: _CELL_PX, _CELL_PX // 2 :: _CELL_PX].reshape(count, -1)
    nearness = 1 / np.maximum(middle.astype(np.float32) / 1000, 0.4)
    return np.concatenate([colours, nearness], axis=1, dtype=np.float32)


def _across_clusters(
    rng: np.random.Generator,
    poses: Pose,
    group: NDArray[np.integer],
    count: int,
    *,
    within_m: float,
    least_turn_rad: float = -1.0,
) -> NDArray[np.intp]:
    """Return at most `count` ordered pairs (.., 2) of different clusters that are closer and turned more than this."""
    pairs = KDTree(poses[:, :2]).query_pairs(within_m, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    turn = np.abs(wrap_angle(poses[pairs[:, 0], 2] - poses[pairs[:, 1], 2]))
    pairs = pairs[(group[pairs[:, 0]] != group[pairs[:, 1]]) & (turn > least_turn_rad)]
    return pairs[rng.choice(len(pairs), min(count, len(pairs)), replace=False)]


def _perceptual_aliases(
    rng: np.random.Generator, poses: Pose, group: NDArray[np.integer], descriptors: NDArray[np.float32], count: int
) -> NDArray[np.intp]:
    """Return pairs (count, 2) of similar images that are far apart or have opposite headings."""
    sources = rng.choice(len(poses), count, replace=count > len(poses))
    squares = (descriptors**2).sum(1)
    # Squared distances by the binomial formula: one matrix product instead of N x N differences.
    apart = squares[sources, None] + squares - 2 * descriptors[sources] @ descriptors.T
    shift = poses[sources, None, :2] - poses[None, :, :2]
    far = np.hypot(shift[..., 0], shift[..., 1]) > NEAR_M
    far |= np.abs(wrap_angle(poses[sources, None, 2] - poses[None, :, 2])) > OPPOSITE_RAD
    apart[~far | (group[sources, None] == group)] = np.inf
    best = np.argpartition(apart, min(_ALIAS_CANDIDATES, len(poses) - 1), axis=1)[:, :_ALIAS_CANDIDATES]
    targets = best[np.arange(count), rng.integers(best.shape[1], size=count)]
    found = np.isfinite(apart[np.arange(count), targets])
    return np.column_stack([sources, targets])[found]


ROBOT_RADIUS_M = LOCOBOT.clear_radius_m
"""A straight line is free if its clearance is larger than this."""


_SPACING_M, _TURN_RAD = 0.12, radians(10)
"""Distance and rotation between the images of a drive (ours, equal to the simulator's tour)."""
_FULL_TURN_SHARE = 0.3
"""Share of visited places with a full turn (ours)."""
_FAR_M, _FAR_RAD = 3.0, radians(92)
"""Pairs with a larger distance or difference of heading are far, for counting false positives (ours)."""
_AROUND_M = 3.0
"""Pairs with a blocked straight line are far if the shortest path is longer than this (behind a wall; ours)."""
_NEAR_M, _NEAR_RAD = 1.2, radians(34)
"""Near pairs have a smaller distance and difference of heading, and a visible target on a free straight line (ours)."""


def sample_drive_poses(floor: FreeSpace, rng: np.random.Generator, count: int) -> Pose:
    """Return (count, 3) poses in the order of a drive."""
    here = floor.sample_poses(rng, 1, min_clearance_m=0.3)[0]
    parts: list[Pose] = [here[None]]
    while sum(map(len, parts)) < count:
        goal = floor.sample_poses(rng, 1, min_clearance_m=0.3)[0]
        path = floor.path(here[:2], goal[:2])
        # A goal in the same place gives no path to follow.
        if path is None or len(path) < 3:
            continue
        parts.append(_along_path(path, parts[-1][-1, 2]))
        if rng.random() < _FULL_TURN_SHARE:
            parts.append(_turn(parts[-1][-1], 2 * np.pi))
        here = parts[-1][-1]
    return np.concatenate(parts)[:count]


def classify_near_far(poses: Pose, floor: FreeSpace) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which ordered pairs of poses (N, 3) are near and which are far, each (N, N); the diagonal is neither."""
    near, far = np.zeros((2, len(poses), len(poses)), bool)
    for i, pose in enumerate(poses):
        waypoints = relative(np.broadcast_to(pose, poses.shape), poses)
        distance = np.hypot(waypoints[:, 0], waypoints[:, 1])
        turn = np.abs(waypoints[:, 2])
        ahead = np.abs(np.arctan2(waypoints[:, 1], waypoints[:, 0])) < LOCOBOT.camera.horizontal_fov_rad / 2
        far[i] = (distance > _FAR_M) | (turn > _FAR_RAD)
        rows = np.flatnonzero(~far[i])
        clearance = np.full(len(poses), np.inf)
        clearance[rows] = floor.along(np.broadcast_to(pose[:2], (len(rows), 2)), poses[rows, :2])
        blocked = np.flatnonzero(clearance <= 0)
        if len(blocked):
            far[i, blocked] = ~np.isfinite(floor.path_lengths(pose[:2], poses[blocked, :2], limit_m=_AROUND_M))
        near[i] = (distance < _NEAR_M) & (turn < _NEAR_RAD) & ahead & (clearance > ROBOT_RADIUS_M)
    np.fill_diagonal(near, False)
    np.fill_diagonal(far, False)
    return near, far


def _along_path(path: NDArray[np.float64], yaw: float) -> Pose:
    """Return poses that turn towards a path (M, 2) and follow it, heading to the point 0.4 m ahead."""
    marks_m = np.arange(0, lengths_along(path)[-1], _SPACING_M)
    here = points_along(path, marks_m)
    ahead = points_along(path, marks_m + 0.4)
    yaws = np.arctan2(*(ahead - here).T[::-1])
    start = np.array([*here[0], yaw])
    return np.concatenate([_turn(start, float(wrap_angle(yaws[0] - yaw))), np.column_stack([here, yaws])])


def _turn(pose: Pose, angle_rad: float) -> Pose:
    """Return the poses of a turn on the spot by an angle, without the initial pose."""
    steps = max(int(abs(angle_rad) / _TURN_RAD), 1)
    yaws = wrap_angle(pose[2] + angle_rad * np.arange(1, steps + 1) / steps)
    return np.column_stack([np.broadcast_to(pose[:2], (steps, 2)), yaws])
