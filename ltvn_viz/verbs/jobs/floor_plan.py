"""The floor plan of `ltvn app | replay | export`: reads it, aligns it with the map, and reports the alignment."""

import logging
from pathlib import Path

import numpy as np

from ltvn_core.data.exporting.map_files import placed_map
from ltvn_core.data.importing.floor_plan import FloorPlan
from ltvn_core.data.importing.floor_plan_alignment import DOUBTFUL_M, LaidFloorPlan, align_floor_plan
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import OptionError
from ltvn_core.geometry import RigidFit
from ltvn_viz.verbs.floor_plan_options import FloorPlanOptions

_LOG = logging.getLogger(__name__)


def lay_floor_plan(options: FloorPlanOptions, map_file: Path | None) -> LaidFloorPlan | None:
    """Return the plan of the options, aligned with a map if there is one; None without a plan.

    Raises DriveError for an unreadable plan, OptionError for invalid pairs, RecordingError and MapError for the map.
    """
    if options.floor_plan is None:
        if options.align:
            raise OptionError("--align gives the position of a floor plan; name the plan with --floor-plan map.yaml.")
        return None
    laid = LaidFloorPlan(FloorPlan.open(options.floor_plan), np.zeros(3))
    if not options.align:
        return laid
    if map_file is None:
        raise OptionError("--align refers to nodes of a map; give the map with --map.")
    poses = placed_map(Recording.open(map_file)).poses
    alignment = align_floor_plan(options.align, poses)
    laid = laid.moved_to(alignment.pose)
    _tell(alignment, laid.plan.cells_at([pose[:2] for pose in poses.values()]))
    return laid


def _tell(alignment: RigidFit, under_nodes: np.ndarray) -> None:
    """Report how well the pairs agree, and how many nodes are on free floor."""
    x, y, yaw = alignment.pose
    _LOG.info(
        "The plan's origin lies at %.2f m, %.2f m, turned by %.1f degrees; the points are off by %.2f m. "
        "%d of %d nodes are on its free floor.",
        *(x, y, np.degrees(yaw), alignment.error_m, (under_nodes == 0).sum(), len(under_nodes)),
    )
    if alignment.error_m > DOUBTFUL_M:
        _LOG.warning("The points do not fit: one is wrong, or odometry drifted far.")
