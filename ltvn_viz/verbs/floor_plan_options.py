"""Options of the verbs that draw a floor plan below a map."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError

if TYPE_CHECKING:
    from ltvn_core.data.importing.floor_plan_alignment import LaidFloorPlan

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class FloorPlanOptions:
    """Options for a floor plan and its alignment with the map."""

    floor_plan: Path | None = None
    """Floor plan of the building to draw below the map: the map.yaml of nav2. `ltvn export` writes maps in its
    frame."""
    align: tuple[str, ...] = ()
    """Alignment of the plan: at least two pairs NODE=X,Y of a node and its position on the plan in metres, such as
    17=-1.5,2. By default, the plan has the same frame as the map, which is the odometry frame."""

    def lay_floor_plan(self, map_file: Path | None) -> "LaidFloorPlan | None":
        """Return the plan, aligned with a map if there is one, and report how well; None without a plan.

        Raises DriveError for an unreadable plan, OptionError for invalid pairs, RecordingError and MapError for the
        map.
        """
        import numpy as np

        from ltvn_core.data.exporting.map_files import placed_map
        from ltvn_core.data.importing.floor_plan import FloorPlan
        from ltvn_core.data.importing.floor_plan_alignment import DOUBTFUL_M, LaidFloorPlan, align_floor_plan
        from ltvn_core.data.recording.reader import Recording

        if self.floor_plan is None:
            if self.align:
                raise OptionError(
                    "--align gives the position of a floor plan; name the plan with --floor-plan map.yaml."
                )
            return None
        laid = LaidFloorPlan(FloorPlan.open(self.floor_plan), np.zeros(3))
        if not self.align:
            return laid
        if map_file is None:
            raise OptionError("--align refers to nodes of a map; give the map with --map.")
        poses = placed_map(Recording.open(map_file)).poses
        alignment = align_floor_plan(self.align, poses)
        laid = laid.moved_to(alignment.pose)
        under_nodes = laid.plan.cells_at([pose[:2] for pose in poses.values()])
        x, y, yaw = alignment.pose
        _LOG.info(
            "The plan's origin lies at %.2f m, %.2f m, turned by %.1f degrees; the points are off by %.2f m. "
            "%d of %d nodes are on its free floor.",
            *(x, y, np.degrees(yaw), alignment.error_m, (under_nodes == 0).sum(), len(under_nodes)),
        )
        if alignment.error_m > DOUBTFUL_M:
            _LOG.warning("The points do not fit: one is wrong, or odometry drifted far.")
        return laid
