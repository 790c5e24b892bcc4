"""Alignment of a floor plan with a map: the frame of the map itself, or pairs of a node and its point on the plan.

Owns the syntax of a pair and the checks of pairs. The plan is moved rigidly and never scaled, because plan and map are
both in metres.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np

from ltvn_core.data.importing.floor_plan import MOST_M, FloorPlan
from ltvn_core.errors import OptionError
from ltvn_core.geometry import RigidFit, compose, invert, rigid_fit
from ltvn_core.types import NodeId, Pose

LEAST_PAIRS = 2
LEAST_APART_M = 0.5
"""Least extent of the points along x or y, in metres; closer points do not determine the rotation."""
DOUBTFUL_M = 0.5
"""Error in metres above which the pairs are probably wrong, or odometry has drifted much."""
_FORM = "NODE=X,Y, in metres of the plan, such as 17=-1.5,2"


class LaidFloorPlan(NamedTuple):
    """A floor plan aligned with a map."""

    plan: FloorPlan
    """The plan in the frame of the map."""
    frame: Pose
    """Pose (3,) of the plan's own frame in the frame of the map."""

    def moved_to(self, frame: Pose) -> Self:
        """Return the plan moved so that its own frame has the pose `frame` (3,) in the frame of the map."""
        return self._replace(plan=self.plan.moved(compose(frame, invert(self.frame))), frame=frame)


def align_floor_plan(pairs: Sequence[str], poses: Mapping[NodeId, Pose]) -> RigidFit:
    """Return the alignment of a plan from pairs `NODE=X,Y`; without pairs, the identity.

    Args:
        pairs: Empty, or at least two pairs.
        poses: Pose (3,) of each node of the map.

    Raises:
        OptionError: A pair cannot be read or does not name a node, or all points are at one place.
    """
    if not pairs:
        return RigidFit(np.zeros(3), 0.0)
    found = [_pair(text) for text in pairs]
    missing = [str(node) for _, node in found if node not in poses]
    if missing:
        raise OptionError(
            f"The map has no node {missing[0]:.20}; `ltvn replay` shows a node's number when it is clicked, and "
            f"`ltvn export --svg` when it is pointed at. It has {len(poses):,} nodes."
        )
    on_plan = np.array([point for point, _ in found])
    on_map = np.array([poses[node][:2] for _, node in found])
    spread_m = min(float(np.ptp(points, axis=0).max()) for points in (on_plan, on_map))
    if len(found) < LEAST_PAIRS or spread_m < LEAST_APART_M:
        raise OptionError(
            f"--align needs at least {LEAST_PAIRS} pairs, better 3, at places more than {LEAST_APART_M} m apart."
        )
    return rigid_fit(on_plan, on_map)


def _pair(text: str) -> tuple[tuple[float, float], NodeId]:
    """Parse a node and a point of the plan (x_m, y_m). The node comes first, because an argument must not begin with a
    minus.

    Raises OptionError.
    """
    node, _, point = text.partition("=")
    try:
        x, y = map(float, point.split(","))
        if not (abs(x) <= MOST_M and abs(y) <= MOST_M):
            raise ValueError
        return (x, y), int(node)
    except ValueError as error:
        raise OptionError(f"--align takes {_FORM}; got {text!r:.40}.") from error
