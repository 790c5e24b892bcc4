"""Which doors may be closed at once, so that most of a scene can still be reached."""

from collections.abc import Collection

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ltvn_core.simulation.scene import Scene

_CONNECTED_SHARE = 0.6
"""At least this share of the area of all rooms hangs together, whatever is closed,"""
_CLOSED_SHARE = 0.5
"""and at most this share of the doors is."""


class OpenRoutes:
    """The rooms of a scene and the doors between them."""

    def __init__(self, scene: Scene) -> None:
        """Read rooms and doors from a scene."""
        self.doors = len(scene.parts.doors)
        """Doors have the numbers below this."""
        self._areas_m2 = np.array([room.area_m2 for room in scene.rooms])
        self._doors = np.array([door.rooms for door in scene.parts.doors], np.intp).reshape(-1, 2)
        open_always = [door.rooms for door in scene.parts.doorways if door not in scene.parts.doors]
        self._passages = np.array(open_always, np.intp).reshape(-1, 2)

    def remain(self, closed: Collection[int]) -> bool:
        """Return whether enough of the scene still hangs together with these doors closed."""
        if len(closed) > _CLOSED_SHARE * self.doors:
            return False
        stays = np.ones(self.doors, bool)
        stays[list(closed)] = False
        first, second = np.concatenate([self._doors[stays], self._passages]).T
        rooms = len(self._areas_m2)
        _, piece = connected_components(coo_array((np.ones(len(first)), (first, second)), (rooms, rooms)))
        return np.bincount(piece, self._areas_m2).max() >= _CONNECTED_SHARE * self._areas_m2.sum()
