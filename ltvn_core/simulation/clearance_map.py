"""The clearance map of a scene: distance to the nearest obstacle, random free poses and shortest paths.

A 2-D grid of the floor, in which obstacles are blocked cells. The physics uses these cells, extruded to blocks, instead
of the visible surfaces, so that it agrees with planning about every cell. Also wraps functions of `scipy.ndimage` on
boolean grids, with types.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Pose

Mask = NDArray[np.bool_]
"""(rows, columns) true or false per cell of a grid."""


def distance_transform(cells: Mask) -> NDArray[np.float64]:
    """Return the distance (rows, columns) in cells to the nearest false cell; 0 in false cells."""
    return cast(NDArray[np.float64], ndimage.distance_transform_edt(cells))


def nearest_true(cells: Mask) -> NDArray[np.intp]:
    """Return row and column (2, rows, columns) of the true cell nearest to each cell."""
    nearest = ndimage.distance_transform_edt(~cells, return_distances=False, return_indices=True)
    return cast(NDArray[np.int32], nearest).astype(np.intp)


def connected_components(cells: Mask) -> tuple[NDArray[np.int32], int]:
    """Label the connected components of true cells (4 neighbours).

    Returns:
        The number of each cell's component (rows, columns), from 1, or 0 in false cells; and the number of components.
    """
    numbers, count = cast(Any, ndimage.label(cells))
    return numbers, int(count)


PLANNING_MARGIN_M = 0.04
OBSTACLE_HEIGHT_M = LOCOBOT.clear_height_m
"""Height below which surfaces are obstacles, in metres; the robot passes under higher ones."""
PLANNING_CLEARANCE_M = LOCOBOT.clear_radius_m + PLANNING_MARGIN_M
"""Clearance of paths and random poses, for the centre of a LoCoBot, in metres: its radius and a margin."""
_MOVES = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (2, -1), (1, -2))
"""Steps (rows, columns) to the 16 neighbours of a cell, one of each opposite pair. A knight's move may pass the corner
of a cell that is not navigable itself, but that costs less than a cell of clearance."""
_SNAP_LIMIT_M = 0.5
"""A start or goal closer to an obstacle than the planning clearance is moved to the nearest navigable cell within this
distance."""
_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)
_FACES = np.array(
    [[0, 1, 5], [0, 5, 4], [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7], [4, 5, 6], [4, 6, 7]]
)


@dataclass(frozen=True, eq=False)
class ClearanceMap:
    """The free and blocked cells of a floor; rows run along y, columns along x."""

    blocked: NDArray[np.bool_]
    """(rows, columns) cells with an obstacle up to the height of a table; the border is blocked."""
    origin: NDArray[np.float64]
    """(2,) x and y of the grid's lower corner in metres."""
    resolution_m: float = 0.05
    """Side of a cell, in metres."""
    floor: NDArray[np.bool_] | None = None
    """Cells (rows, columns) that were navigable before the world changed; None if it did not. Closed doors divide them
    into several pieces, and the robot may be in any of these."""

    @cached_property
    def grid(self) -> NDArray[np.float64]:
        """Metres (rows, columns) from a cell's centre to the nearest obstacle's edge; negative inside obstacles."""
        outside = distance_transform(~self.blocked)
        inside = distance_transform(self.blocked)
        half_cell = np.where(self.blocked, 0.5, -0.5)
        return (outside - inside + half_cell) * self.resolution_m

    @cached_property
    def navigable(self) -> NDArray[np.bool_]:
        """Cells (rows, columns) with the planning clearance in the largest connected piece of floor, or in any piece
        that reaches the former `floor`."""
        components, count = connected_components(self.grid > PLANNING_CLEARANCE_M)
        if count == 0:
            return np.zeros_like(self.blocked)
        if self.floor is not None:
            former = np.unique(components[self.floor])
            return np.isin(components, former[former > 0])
        sizes = np.bincount(components.ravel())
        sizes[0] = 0  # Component 0 holds the cells that are not free.
        return components == int(sizes.argmax())

    def at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the distance in metres (...) from points (..., 2) to the nearest obstacle; 0 inside one.

        Interpolates linearly between the centres of cells.
        """
        x, y = self._grid_coordinates(xy)
        column = np.floor(x).astype(np.intp)
        row = np.floor(y).astype(np.intp)
        right = x - column
        up = y - row
        grid = self.grid
        low = grid[row, column] * (1 - right) + grid[row, column + 1] * right
        high = grid[row + 1, column] * (1 - right) + grid[row + 1, column + 1] * right
        return np.maximum(low * (1 - up) + high * up, 0.0)

    def along(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.float64]:
        """Return the smallest clearance in metres (N,) on the straight lines from starts (N, 2) to ends (N, 2)."""
        starts, ends = (np.asarray(points, np.float64).reshape(-1, 2) for points in (starts, ends))
        least = np.empty(len(starts))
        for first in range(0, len(starts), 4096):  # Bounds the memory of a million lines.
            part = slice(first, first + 4096)
            least[part] = self._along(starts[part], ends[part])
        return least

    def sample_poses(
        self, rng: np.random.Generator, count: int, *, min_clearance_m: float = PLANNING_CLEARANCE_M
    ) -> Pose:
        """Draw poses (count, 3) uniformly over the navigable floor and all headings.

        Raises:
            ValueError: No navigable cell has `min_clearance_m`.
        """
        cells = np.argwhere(self.navigable & (self.grid >= min_clearance_m))
        if len(cells) == 0:
            raise ValueError(
                f"No navigable floor has a clearance of {min_clearance_m} m. Ask for a smaller clearance, or use a "
                "scene with more free floor."
            )
        poses = np.empty((0, 3))
        while len(poses) < count:
            drawn = cells[rng.integers(len(cells), size=count)][:, ::-1] + rng.random((count, 2))
            xy = self.origin + drawn * self.resolution_m
            xy = xy[self.at(xy) >= min_clearance_m]
            yaw = rng.uniform(-np.pi, np.pi, len(xy))
            poses = np.concatenate([poses, np.column_stack([xy, yaw])])
        return poses[:count]

    def path(self, start: ArrayLike, goal: ArrayLike) -> NDArray[np.float64] | None:
        """Return a path (M, 2) from start (2,) to goal (2,) through the middle of free space; None if there is no path.

        Not the shortest path: cells near obstacles cost up to four times as much. See `path_lengths` for lengths.
        """
        first, last = (int(self._nodes(point)[0]) for point in (start, goal))
        if first < 0 or last < 0:
            return None
        cost, before = dijkstra(self._clearance_weighted_graph, indices=first, return_predecessors=True)
        if not np.isfinite(cost[last]):
            return None
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        inner = self._centres[nodes[::-1]][1:-1]
        return np.vstack([np.asarray(start, np.float64)[:2], inner, np.asarray(goal, np.float64)[:2]])

    def path_lengths(self, start: ArrayLike, goals: ArrayLike, *, limit_m: float = np.inf) -> NDArray[np.float64]:
        """Return the lengths in metres (N,) of the shortest paths from start (2,) to goals (N, 2).

        A length is inf if there is no path or it is longer than `limit_m`. Exact if the straight line is free,
        otherwise along the grid's 16 directions (at most 3 % too long).
        """
        start = np.asarray(start, np.float64).reshape(-1)[:2]
        goals = np.asarray(goals, np.float64).reshape(-1, 2)
        lengths = np.sqrt(((goals - start) ** 2).sum(1))
        blocked = (lengths <= limit_m) & (
            self.along(np.broadcast_to(start, goals.shape), goals) <= PLANNING_CLEARANCE_M
        )
        if blocked.any():
            # Snapping may move a start and a goal closer together, so the straight line stays a lower bound.
            lengths[blocked] = np.maximum(lengths[blocked], self._grid_lengths(start, goals[blocked], limit_m))
        return np.where(lengths <= limit_m, lengths, np.inf)

    def _grid_lengths(self, start: NDArray, goals: NDArray, limit_m: float) -> NDArray[np.float64]:
        first = int(self._nodes(start)[0])
        last = self._nodes(goals)
        if first < 0:
            return np.full(len(goals), np.inf)
        lengths = dijkstra(self._graph, indices=first, limit=limit_m)
        return np.where(last >= 0, lengths[last], np.inf)

    def _along(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
        longest = float(np.sqrt(((ends - starts) ** 2).sum(1)).max(initial=0.0))
        parts = np.linspace(0, 1, 2 + int(longest / (self.resolution_m / 2)))[:, None, None]
        return self.at(starts * (1 - parts) + ends * parts).min(0)

    def _grid_coordinates(self, xy: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return columns and rows, 0 at the centre of the first cell, clipped to the grid."""
        rows, columns = self.blocked.shape
        cells = (np.asarray(xy, np.float64)[..., :2] - self.origin) / self.resolution_m - 0.5
        return np.clip(cells[..., 0], 0, columns - 1.001), np.clip(cells[..., 1], 0, rows - 1.001)

    def _nodes(self, xy: ArrayLike) -> NDArray[np.intp]:
        """Return the graph nodes (N,) nearest to points (N, 2), -1 where none is within `_SNAP_LIMIT_M`."""
        points = np.asarray(xy, np.float64).reshape(-1, np.shape(xy)[-1])[:, :2]
        x, y = self._grid_coordinates(points)
        row = np.rint(y).astype(np.intp)
        column = np.rint(x).astype(np.intp)
        near_row, near_column = self._nearest_navigable
        node = self._numbers[near_row[row, column], near_column[row, column]]
        away = np.sqrt(((self._centres[node] - points) ** 2).sum(1)) if len(self._centres) else np.inf
        return np.where(away <= _SNAP_LIMIT_M, node, -1)

    @cached_property
    def _nearest_navigable(self) -> NDArray[np.intp]:
        """(2, rows, columns): row and column of the navigable cell nearest to each cell."""
        return nearest_true(self.navigable)

    @cached_property
    def _numbers(self) -> NDArray[np.intp]:
        """(rows, columns): each navigable cell's node in the graph, -1 elsewhere."""
        numbers = np.full(self.blocked.shape, -1, np.intp)
        numbers[self.navigable] = np.arange(np.count_nonzero(self.navigable))
        return numbers

    @cached_property
    def _centres(self) -> NDArray[np.float64]:
        """(nodes, 2): x and y in metres of the centre of each node's cell."""
        cells = np.argwhere(self.navigable)[:, ::-1]
        return self.origin + (cells + 0.5) * self.resolution_m

    @cached_property
    def _graph(self) -> csr_array:
        """Adjacency matrix (nodes, nodes) of navigable cells; weights are distances in metres."""
        numbers = self._numbers
        count = len(self._centres)
        sources = []
        targets = []
        metres = []
        for down, right in _MOVES:
            source, target = _shifted(numbers, down, right)
            linked = (source >= 0) & (target >= 0)
            sources.append(source[linked])
            targets.append(target[linked])
            metres.append(np.full(int(linked.sum()), np.sqrt(down * down + right * right) * self.resolution_m))
        source, target, metre = (np.concatenate(parts) for parts in (sources, targets, metres))
        ends = (np.concatenate([source, target]), np.concatenate([target, source]))
        return coo_array((np.concatenate([metre, metre]), ends), (count, count)).tocsr()

    @cached_property
    def _clearance_weighted_graph(self) -> csr_array:
        """`_graph` with edges that cost more near obstacles, so that paths keep to the middle of free space."""
        graph = self._graph.tocoo()
        cost_factor = 1 + 3 * np.exp(-(self.grid[self.navigable] - PLANNING_CLEARANCE_M) / 0.12)
        cost = graph.data * (cost_factor[graph.row] + cost_factor[graph.col]) / 2
        return coo_array((cost, (graph.row, graph.col)), graph.shape).tocsr()


def _shifted(cells: NDArray, down: int, right: int) -> tuple[NDArray, NDArray]:
    """Return two views of a grid (rows, columns) whose entries are `down` rows and `right` columns apart."""
    rows, columns = cells.shape
    if right >= 0:
        return cells[: rows - down, : columns - right], cells[down:, right:]
    return cells[: rows - down, -right:], cells[down:, :right]


def extrude_blocked_cells(clearance: ClearanceMap, height_m: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (V, 3) in metres and faces (F, 3) of blocks of a height that cover all blocked cells.

    The blocks have no bottom: nothing can reach it.
    """
    blocks = np.array(list(_rectangles(clearance.blocked)), np.float64).reshape(-1, 2, 2)
    low = blocks[:, 0] * clearance.resolution_m + clearance.origin
    high = blocks[:, 1] * clearance.resolution_m + clearance.origin
    low3 = np.column_stack([low, np.zeros(len(blocks))])
    high3 = np.column_stack([high, np.full(len(blocks), height_m)])
    vertices = low3[:, None] + _CORNERS * (high3 - low3)[:, None]
    faces = _FACES + 8 * np.arange(len(blocks))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32)


def _rectangles(blocked: NDArray[np.bool_]) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Cover the blocked cells with rectangles ((column, row), (column, row)), greedily: first right, then up.

    Merging cells keeps the number of triangles low, which decides how fast the physics runs.
    """
    uncovered = blocked.copy()
    rectangles = []
    for row, column in np.argwhere(blocked):
        if not uncovered[row, column]:
            continue
        end = column + 1
        while end < uncovered.shape[1] and uncovered[row, end]:
            end += 1
        top = row + 1
        while top < uncovered.shape[0] and uncovered[top, column:end].all():
            top += 1
        uncovered[row:top, column:end] = False
        rectangles.append(((column, row), (end, top)))
    return rectangles
