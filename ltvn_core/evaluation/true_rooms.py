"""Which room each node of a map lies in, as the simulated scene knows it: for the maintenance `brm-rooms`."""

from collections.abc import Callable
from functools import cache

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.simulation.scene import Scene
from ltvn_core.systems.brm import RoomOf
from ltvn_core.types import FrameId, NodeId, Observation


def true_rooms(scene: Scene, observation: Callable[[FrameId], Observation]) -> RoomOf:
    """Return what tells the rooms of nodes; `observation` returns their images.

    It raises MapError for images that have no exact poses.
    """
    truth = GroundTruth(scene.clearance, observation)

    @cache  # Nodes do not move.
    def room_of(node: NodeId) -> int | None:
        x, y, _ = truth.poses([node])[0]
        inside = (k for k, room in enumerate(scene.rooms) if room.x0 <= x <= room.x1 and room.y0 <= y <= room.y1)
        return next(inside, None)

    return room_of
