"""The floor plan of `ltvn app | replay | export`: read, laid under the map, and how well it lies there."""

import logging
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ltvn_core.data.exporting.map_files import placed_map
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.importing.floor_plan_alignment import DOUBTFUL_M, Alignment, align_floor_plan
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.types import Pose
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions

_LOG = logging.getLogger(__name__)


class LaidFloorPlan(NamedTuple):
    """A floor plan under a map."""

    plan: FloorPlan
    """In the frame of the map."""
    frame: Pose
    """(3,) pose of the plan's own frame in the map's."""


def lay_floor_plan(options: FloorPlanOptions, map_file: Path | None) -> LaidFloorPlan | None:
    """Return the plan of the options under a map, or under none yet; None without a plan.

    Raises DriveError for a plan that cannot be read, OptionError for pairs that cannot be right, RecordingError and
    MapError for the map of those pairs.
    """
    if options.floor_plan is None:
        if options.align:
            raise OptionError("--align says where a floor plan lies; name it by --floor-plan map.yaml.")
        return None
    plan = FloorPlan.open(options.floor_plan)
    if not options.align:
        return LaidFloorPlan(plan, np.zeros(3))
    if map_file is None:
        raise OptionError("--align names nodes of a map; name the map too, by --map.")
    poses = placed_map(Recording.open(map_file)).poses
    alignment = align_floor_plan(options.align, poses)
    laid = plan.moved(alignment.frame)
    _tell(alignment, laid.cells_at([pose[:2] for pose in poses.values()]))
    return LaidFloorPlan(laid, alignment.frame)


def _tell(alignment: Alignment, under_nodes: np.ndarray) -> None:
    """Say how well the pairs agree, and how many nodes are on free floor."""
    x, y, yaw = alignment.frame
    _LOG.info(
        "The plan's origin lies at %.2f m, %.2f m, turned by %.1f degrees; the points are off by %.2f m. "
        "%d of %d nodes are on its free floor.",
        *(x, y, np.degrees(yaw), alignment.error_m, (under_nodes == 0).sum(), len(under_nodes)),
    )
    if alignment.error_m > DOUBTFUL_M:
        _LOG.warning("The points do not fit: one is wrong, or odometry drifted far.")
