"""A body that is a disc in the plane: the physics of PyBullet for a round body that cannot tip over, in numpy.

Obstacles are the parts of the scene's triangles between the body's lower and upper end, seen from above: a wall is a
line, the top of a table an area. They are exact triangles, as in PyBullet, and are stored in a grid for fast search.
See `ltvn_core.simulation.body`.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.simulation.body import (
    CONTACT_GAP_M,
    PERSON_RADIUS_M,
    SCENE_OBSTACLES,
    TICK_S,
    WALL_FRICTION,
    triangles_in_reach,
)
from ltvn_core.types import Pose

_STRIDE = 1 << 24
"""Difference between the numbers of cells in neighbouring columns, larger than the number of rows of any scene."""
_FLAT_M2 = 1e-10
_PERSON_FRICTION = 0.5
"""Coefficient of friction between body and people, PyBullet's default."""
_SKIN_M = 0.001
"""Distance that the body keeps from obstacles, in metres: PyBullet's default margin of a mesh."""
_OVERLAP_KEPT = 0.92
"""Share of an overlap that remains after one tick, as in PyBullet; it is halved in 35 ms."""
_REACH_M = 0.1
"""Distance around the body within which obstacles are collected, and the motion after which they are collected again,
in metres."""
_CORRECTIONS = 8
"""Maximum number of contacts resolved in one tick, as in a corner between two walls."""
_RING = np.stack([np.cos(angles := np.arange(16) * math.pi / 8), np.sin(angles)], axis=1)
_RING_STEP_M = 0.05
_RINGS = 40


class TriangleGrid:
    """Triangles in the plane in a uniform grid of cells."""

    def __init__(self, triangles: NDArray[np.floating], *, low_m: float, high_m: float, cell_m: float) -> None:
        """Cut triangles (T, 3, 3) to the heights between `low_m` and `high_m`, and sort them into cells.

        Args:
            triangles: In metres, z up.
            low_m: Lower end of the band.
            high_m: Upper end of the band.
            cell_m: Side of a cell.
        """
        below = _cut_above(triangles.astype(np.float64).reshape(-1, 3, 3), high_m)
        inside = _cut_above(below * (1, 1, -1), -low_m)
        self._triangles = inside[:, :, :2]
        self._cell_m = cell_m
        self._keys, self._rows = self._sorted_into_cells()

    def near(self, x_m: float, y_m: float) -> NDArray[np.float64]:
        """Return the triangles (N, 3, 2) that reach into the cell of a point or one of its eight neighbours."""
        column = int(np.floor(x_m / self._cell_m))
        row = int(np.floor(y_m / self._cell_m))
        edges = [(column + step) * _STRIDE + row + side for step in (-1, 0, 1) for side in (-1, 2)]
        found = np.searchsorted(self._keys, edges)
        rows = np.concatenate([self._rows[found[k] : found[k + 1]] for k in (0, 2, 4)])
        return self._triangles[np.unique(rows)]

    def _sorted_into_cells(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the sorted numbers of cells and the triangle in each; a large triangle is in many cells."""
        first = np.floor(self._triangles.min(axis=1) / self._cell_m).astype(np.int64)
        last = np.floor(self._triangles.max(axis=1) / self._cell_m).astype(np.int64)
        columns, rows = (last - first + 1).T
        triangle = np.repeat(np.arange(len(first)), columns * rows)
        begin = np.repeat(np.cumsum(columns * rows) - columns * rows, columns * rows)
        column, row = np.divmod(np.arange(len(triangle)) - begin, rows[triangle])
        keys = (first[triangle, 0] + column) * _STRIDE + first[triangle, 1] + row
        order = np.argsort(keys, kind="stable")
        return keys[order], triangle[order]


class Outlines:
    """A few triangles near a point: the edges of all, and the areas of those that are not lines."""

    def __init__(self, edges: NDArray[np.float64], areas: NDArray[np.float64]) -> None:
        """Take edges (E, 4), each x0, y0, x1 and y1, and triangles with an area (A, 3, 2)."""
        self._x = edges[:, 0]
        self._y = edges[:, 1]
        self._dx = edges[:, 2] - edges[:, 0]
        self._dy = edges[:, 3] - edges[:, 1]
        length2 = np.maximum(self._dx**2 + self._dy**2, 1e-18)
        self._sx = self._dx / length2
        self._sy = self._dy / length2
        self._areas = areas

    def nearest(self, x_m: float, y_m: float) -> tuple[float, float, float]:
        """Return the distance from a point to the nearest outline, and the nearest point on it. The distance is 0
        within an area."""
        if len(self._areas) and _contains(self._areas, np.array([x_m, y_m])).any():
            return 0.0, x_m, y_m
        to_x = x_m - self._x
        to_y = y_m - self._y
        share = to_x * self._sx
        share += to_y * self._sy
        np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
        to_x -= share * self._dx
        to_y -= share * self._dy
        distance2 = to_x * to_x
        distance2 += to_y * to_y
        k = int(distance2.argmin())
        return math.sqrt(distance2[k]), x_m - float(to_x[k]), y_m - float(to_y[k])


def near_outlines(
    triangles: Sequence[NDArray[np.float64]], x_m: float, y_m: float, *, within_m: float
) -> Outlines | None:
    """Return the outlines of triangles (N, 3, 2) within a distance of a point; None if there are none."""
    point = np.array([x_m, y_m])
    all_triangles = np.concatenate([*triangles, np.zeros((0, 3, 2))])
    starts = all_triangles
    ends = all_triangles[:, (1, 2, 0)]
    along = ends - starts
    share = ((point - starts) * along).sum(2) / np.maximum((along**2).sum(2), 1e-18)
    to_edge = point - starts - np.clip(share, 0, 1)[..., None] * along
    is_near = (to_edge**2).sum(2) < within_m**2
    edges = np.concatenate([starts, ends], axis=2)[is_near]
    areas = all_triangles[is_near.any(axis=1) | _contains(all_triangles, point)]
    areas = areas[np.abs(_doubled_areas(areas)) > _FLAT_M2]
    if not len(edges) and not len(areas):
        return None
    # Neighbours share edges, and a wall is seen from above as many triangles that are one line.
    flipped = (edges[:, 0] > edges[:, 2]) | ((edges[:, 0] == edges[:, 2]) & (edges[:, 1] > edges[:, 3]))
    edges[flipped] = edges[flipped][:, (2, 3, 0, 1)]
    return Outlines(np.unique(edges, axis=0), areas)


def _cut_above(triangles: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    """Return the parts of triangles (T, 3, 3) at or below a height, as triangles again."""
    above = triangles[:, :, 2] > height_m
    count = above.sum(axis=1)
    is_cut = (count == 1) | (count == 2)
    cut = triangles[is_cut]
    # Begin with the corner that is alone on its side, so that the plane crosses both of its edges.
    alone = (above[is_cut] == (count[is_cut] == 1)[:, None]).argmax(axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    corner, second, third = np.moveaxis(np.take_along_axis(cut, order[..., None], axis=1), 1, 0)
    crossings = [
        corner + (end - corner) * ((height_m - corner[:, 2]) / (end[:, 2] - corner[:, 2]))[:, None]
        for end in (second, third)
    ]
    is_tip = count[is_cut] == 2
    tips = np.stack([corner, *crossings], axis=1)[is_tip]
    stumps = [np.stack([crossings[0], second, third], axis=1), np.stack([crossings[0], third, crossings[1]], axis=1)]
    return np.concatenate([triangles[count == 0], tips, *(part[~is_tip] for part in stumps)])


def _contains(triangles: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which triangles (T, 3, 2) contain a point, (T,)."""
    along = np.roll(triangles, -1, axis=1) - triangles
    to_point = point - triangles
    sides = along[..., 0] * to_point[..., 1] - along[..., 1] * to_point[..., 0]
    return np.logical_or((sides > 0).all(axis=1), (sides < 0).all(axis=1))


def _doubled_areas(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    first = triangles[:, 1] - triangles[:, 0]
    second = triangles[:, 2] - triangles[:, 0]
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


class _Obstacle(NamedTuple):
    """The obstacle nearest to a point."""

    distance_m: float
    """Distance from the point, in metres; 0 within the obstacle."""
    x_m: float
    """Coordinates of the obstacle's nearest point, in metres."""
    y_m: float
    friction: float = WALL_FRICTION


class PlanarBody:
    """A disc among the outlines of a scene. Implements `ltvn_core.simulation.body.Body`."""

    def __init__(
        self, vertices: NDArray[np.floating], faces: NDArray[np.integer], start: Pose, spec: RobotSpec
    ) -> None:
        """Create the body at `start` (3,) among the triangles of a scene.

        Args:
            vertices: (V, 3) in metres, z up, the floor at z = 0.
            faces: (F, 3) indices of vertices.
            start: (3,) x, y and yaw of the body.
            spec: The size of the body.
        """
        self._spec = spec
        self._radius_m = spec.radius_m + _SKIN_M
        self._people: list[tuple[float, float]] = []
        self._grids: dict[str, TriangleGrid] = {}
        self.set_obstacles(SCENE_OBSTACLES, vertices, faces)
        self.place(start)

    @property
    def pose(self) -> Pose:
        """Pose of the body, (3,) in the world frame."""
        return np.array([self.x_m, self.y_m, math.remainder(self.yaw_rad, 2 * math.pi)])

    @property
    def in_contact(self) -> bool:
        """Whether the body is in contact with an obstacle now."""
        if self._is_free(self.x_m, self.y_m, CONTACT_GAP_M):
            return False
        return self._nearest(self.x_m, self.y_m).distance_m - self._radius_m < CONTACT_GAP_M

    def set_obstacles(self, group: str, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        """Replace the obstacles of a group by triangles with vertices (V, 3) and faces (F, 3); no faces remove them."""
        triangles = vertices[triangles_in_reach(vertices, faces, self._spec)]
        self._grids[group] = TriangleGrid(
            triangles,
            low_m=self._spec.ground_clearance_m,
            high_m=self._spec.height_m,
            cell_m=self._radius_m + 2 * _REACH_M,
        )
        self._forget()

    def set_people(self, people: Mapping[str, tuple[float, float]]) -> None:
        """Set the positions of people by name, x and y in metres; each is a post that the robot cannot push."""
        self._people = [(float(x_m), float(y_m)) for x_m, y_m in people.values()]
        self._forget_distance()

    def place(self, pose: Pose) -> None:
        """Set the body to `pose` (3,), at rest."""
        self.x_m, self.y_m, self.yaw_rad = (float(value) for value in pose)
        self._forget()

    def tick(self, linear_m_s: float, angular_rad_s: float) -> None:
        """Move the body with the given speeds for one tick of 1/240 s, as far as obstacles allow."""
        turn = angular_rad_s * TICK_S
        ahead = linear_m_s * TICK_S
        heading = self.yaw_rad + turn / 2
        x_m = self.x_m + ahead * math.cos(heading)
        y_m = self.y_m + ahead * math.sin(heading)
        self.yaw_rad += turn  # Nothing stops a round body from turning on the spot.
        if not self._is_free(x_m, y_m, 0.0):
            x_m, y_m = self._resolved(x_m, y_m)
        self.x_m = x_m
        self.y_m = y_m

    def close(self) -> None:
        """Free the memory; closing twice is allowed."""
        self._grids.clear()
        self._forget()

    def _resolved(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return the position that contacts allow for a body whose wheels drive it to a point."""
        overlap_m = self._radius_m - self._nearest(self.x_m, self.y_m).distance_m
        if overlap_m >= self._radius_m:
            return self._way_out()
        # An overlap, which only a moving obstacle can cause, ends gradually. The body's own motion never increases it.
        allowed_m = self._radius_m - max(overlap_m, 0.0) * _OVERLAP_KEPT
        from_x = self.x_m
        from_y = self.y_m
        for _ in range(_CORRECTIONS):
            distance_m, nearest_x, nearest_y, friction = self._nearest(x_m, y_m)
            depth_m = allowed_m - distance_m
            if depth_m <= 1e-9:
                return x_m, y_m
            if distance_m == 0:
                break
            normal_x = (x_m - nearest_x) / distance_m
            normal_y = (y_m - nearest_y) / distance_m
            along = (x_m - from_x) * -normal_y + (y_m - from_y) * normal_x
            # Coulomb friction: motion along the wall is reduced by at most a share of the reduction across the wall.
            held = math.copysign(min(abs(along), friction * depth_m), along)
            x_m += normal_x * depth_m + normal_y * held
            y_m += normal_y * depth_m - normal_x * held
        return self.x_m, self.y_m

    def _way_out(self) -> tuple[float, float]:
        """Return the next position of a body inside an obstacle, on its way to the nearest free place."""
        for ring in range(1, _RINGS):
            for dx, dy in _RING * ring * _RING_STEP_M:
                if self._nearest(self.x_m + dx, self.y_m + dy).distance_m >= self._radius_m:
                    self._forget()
                    share = 1 - _OVERLAP_KEPT
                    return self.x_m + share * float(dx), self.y_m + share * float(dy)
        self._forget()
        return self.x_m, self.y_m

    def _is_free(self, x_m: float, y_m: float, gap_m: float) -> bool:
        """Return whether the last exact distance proves that a point is farther than `gap_m` from any contact."""
        left_m = self._free_m - gap_m
        if left_m <= 0:
            return False
        dx = x_m - self._free_x
        dy = y_m - self._free_y
        return dx * dx + dy * dy < left_m * left_m

    def _nearest(self, x_m: float, y_m: float) -> _Obstacle:
        """Return the obstacle nearest to a point; if there is none within reach, the distance is a lower bound."""
        if self._free_x == x_m and self._free_y == y_m:
            return self._last  # The last search of a tick is the one that the bumper and the next tick need.
        if abs(x_m - self._anchor_x) > _REACH_M / 2 or abs(y_m - self._anchor_y) > _REACH_M / 2:
            self._collect(x_m, y_m)
        best = _Obstacle(self._radius_m + _REACH_M / 4, x_m, y_m)
        if self._outlines is not None:
            found = self._outlines.nearest(x_m, y_m)
            best = _Obstacle(*found) if found[0] < best.distance_m else best
        for person_x, person_y in self._people:
            between_m = math.hypot(x_m - person_x, y_m - person_y)
            if between_m - PERSON_RADIUS_M < best.distance_m:
                share = PERSON_RADIUS_M / max(between_m, 1e-9)
                nearest = person_x + share * (x_m - person_x), person_y + share * (y_m - person_y)
                best = _Obstacle(max(between_m - PERSON_RADIUS_M, 0.0), *nearest, _PERSON_FRICTION)
        self._last = best
        self._free_x = x_m
        self._free_y = y_m
        self._free_m = best.distance_m - self._radius_m
        return best

    def _collect(self, x_m: float, y_m: float) -> None:
        """Collect the outlines near a point."""
        self._anchor_x = x_m
        self._anchor_y = y_m
        near = [grid.near(x_m, y_m) for grid in self._grids.values()]
        self._outlines = near_outlines(near, x_m, y_m, within_m=self._radius_m + _REACH_M)

    def _forget(self) -> None:
        """Forget the collected outlines, after the body or an obstacle was moved."""
        self._anchor_x = math.inf
        self._anchor_y = math.inf
        self._outlines = None
        self._forget_distance()

    def _forget_distance(self) -> None:
        self._last = _Obstacle(0.0, 0.0, 0.0)
        self._free_x = math.inf
        self._free_y = math.inf
        self._free_m = 0.0
