"""Lays a floor plan under a map: by the map's own frame, or by points of the plan at which nodes are known to be.

Owns how a person writes such a pair, and what makes pairs useless. Plan and map are moved as a whole, never stretched:
both are in metres.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ltvn_core.data.importing.floor_plan import MOST_M
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose, rigid_fit
from ltvn_core.types import NodeId, Pose

LEAST_PAIRS = 2
LEAST_APART_M = 0.5
"""Points nearer to each other say nothing of the turn."""
DOUBTFUL_M = 1.0
"""Pairs that agree no better are wrong, or odometry drifted much."""
_FORM = "NODE=X,Y, in metres of the plan, as 17=-1.5,2"


class Alignment(NamedTuple):
    """How a plan lies in a map."""

    frame: Pose
    """(3,) pose of the plan's frame in the map's."""
    error_m: float
    """Root mean square distance between the plan's points and their nodes."""


def align_floor_plan(pairs: Sequence[str], poses: Mapping[NodeId, Pose]) -> Alignment:
    """Return how a plan lies by pairs `NODE=X,Y`; without any, in the map's own frame.

    Args:
        pairs: None, or two and more.
        poses: (3,) of each node of the map.

    Raises:
        OptionError: A pair cannot be read or names no node, or all points are at one place.
    """
    if not pairs:
        return Alignment(np.zeros(3), 0.0)
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
    frame = rigid_fit(on_plan, on_map)
    moved = compose(frame, np.column_stack([on_plan, np.zeros(len(found))]))[:, :2]
    return Alignment(frame, float(np.sqrt(((moved - on_map) ** 2).sum(axis=1).mean())))


def _pair(text: str) -> tuple[tuple[float, float], NodeId]:
    """Return a point of the plan (x_m, y_m) and its node, named first, as an argument must not begin with a minus.

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
