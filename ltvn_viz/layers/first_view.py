"""The initial view of a page: the whole floor, as large as the scene's part of the page allows.

Owns the position of the camera until a person moves it.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from ltvn_core.types import Pose
from ltvn_viz.layers.scene_assets import CUT_HEIGHT_M
from ltvn_viz.session.snapshot import Snapshot

MARGIN = 0.02
"""Least share of the scene's width and height that stays empty on each side."""
USUAL_ASPECT = 1.35
"""Ratio of width to height that is assumed for an unknown window, and for an exported map."""
BACK = np.array([0.0, -0.35, 1.0]) / np.hypot(0.35, 1.0)
"""Unit vector from the floor to the camera; steep, so that walls hide little."""
RIGHT = np.array([1.0, 0.0, 0.0])
UP = np.cross(BACK, RIGHT)
_SAME_PLACE_M = 1e-3
_REMEMBERED = 32
_STORY_MARGIN_M = 1.8
"""Margin of floor around the robot and the door of a story, in metres."""
_MAP_MARGIN_M = 1.0
"""Margin of floor around the nodes of one floor, in metres."""

Corner = ArrayLike
"""Position (x, y) in metres, shape (2,)."""


class View(NamedTuple):
    """Position of a camera and the point that it looks at, each (3,), in metres."""

    position: NDArray[np.float64]
    look_at: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Floor:
    """Extent of the scene: the floor between two corners, with walls up to the height at which they are cut."""

    low: Corner
    high: Corner

    def view(self, aspect: float, fov: float) -> View:
        """Return the nearest view that shows the whole scene.

        Args:
            aspect: Ratio of width to height of the view.
            fov: Vertical angle of view of the camera, in radians.
        """
        (x0, y0), (x1, y1) = np.asarray(self.low, float), np.asarray(self.high, float)
        corners = np.array(list(product((x0, x1), (y0, y1), (0.0, CUT_HEIGHT_M))))
        slope = np.tan(fov / 2) * (1 - 2 * MARGIN)
        up, up_back = _between(corners, UP, slope)
        right, right_back = _between(corners, RIGHT, slope * aspect)
        position = right * RIGHT + up * UP + max(up_back, right_back) * BACK
        return View(position, position - BACK * position[2] / BACK[2])

    def begin(self, server: viser.ViserServer) -> None:
        """Set the initial view of new pages to one that suits most windows."""
        first = server.initial_camera
        view = self.view(USUAL_ASPECT, first.fov)
        first.position = tuple(view.position)
        first.look_at = tuple(view.look_at)


class FirstView:
    """Fits the view of one page to its scene, also after a change of the window's size, until a person moves the
    camera.

    A view that was given in a link stays as it is.
    """

    def __init__(self, floor: Floor, server: viser.ViserServer, client: viser.ClientHandle) -> None:
        """Show all of `floor`."""
        self._floor = floor
        self._camera = client.camera
        self._ours = deque([np.asarray(server.initial_camera.position)], maxlen=_REMEMBERED)
        """Latest camera positions that were sent to the page, which reports them back later."""
        self._story: Floor | None = None
        """Floor on which the running story happens."""

    def show(self, snapshot: Snapshot) -> None:
        """Fit the view: to the place of a running story, else to the floor on show."""
        camera = self._camera
        if snapshot.story_goes_on and self._story is None:
            self._ours.append(np.asarray(camera.position))  # A new story may move the camera.
        self._story = _story_floor(snapshot, self._story) if snapshot.story_goes_on else None
        floor = self._floor if snapshot.floor is None else _around(snapshot.moment.graph.poses)
        view = (self._story or floor).view(camera.aspect, camera.fov)
        if _is_at(camera, [view.position]) or not _is_at(camera, self._ours):
            return
        camera.position, camera.look_at = view
        if not np.allclose(self._ours[-1], view.position):
            self._ours.append(view.position)


def _story_floor(snapshot: Snapshot, before: Floor | None) -> Floor | None:
    """Return the floor around the robot and the story's door; it stays the same while both are well inside."""
    doors = () if snapshot.world is None else snapshot.world.doors
    places = [(each.x, each.y) for each in doors if each.door == snapshot.story_door]
    if snapshot.moment.robot is not None:
        places.append((float(snapshot.moment.robot[0]), float(snapshot.moment.robot[1])))
    if not places:
        return before
    low = np.min(places, axis=0)
    high = np.max(places, axis=0)
    if before is not None and np.all(low > before.low) and np.all(high < before.high):
        return before
    return Floor(low - _STORY_MARGIN_M, high + _STORY_MARGIN_M)


def _around(poses: Pose) -> Floor:
    """Return the floor around nodes with poses (N, 3)."""
    return Floor(poses[:, :2].min(axis=0) - _MAP_MARGIN_M, poses[:, :2].max(axis=0) + _MAP_MARGIN_M)


def _is_at(camera: viser.CameraHandle, places: Sequence[NDArray[np.float64]]) -> bool:
    return bool((np.abs(np.array(places) - camera.position).max(axis=1) < _SAME_PLACE_M).any())


def _between(corners: NDArray[np.float64], across: NDArray[np.float64], slope: float) -> tuple[float, float]:
    """Return the camera's coordinate along `across`, and its least distance, for a view of all corners (N, 3).

    `slope` is the tangent of half the angle of view, reduced by the margin.
    """
    low, high = (float((side * corners @ across + slope * corners @ BACK).max()) for side in (-1, 1))
    return (high - low) / 2, (high + low) / 2 / slope
