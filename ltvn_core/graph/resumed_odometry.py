"""Whether images contradict that a drive goes on in the odometry of the drive before it.

Between two drives with a pause a robot may be carried away without its odometry knowing. Within a drive no edge is made
by odometry over such a pause; between two drives one is, unless images that agree with each other say something else.
Owns that question; who asks it and why is in `drives.continued_drives`.
"""

import logging
from bisect import bisect_left
from collections.abc import Sequence

from ltvn_core.config import BuildingConfig
from ltvn_core.graph.drive_links import DriveLinkSearch
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import PAUSE_S, DriveLink, OdometryGate
from ltvn_core.types import Observation

log = logging.getLogger(__name__)


def separate_contradicted_drives(
    observations: Sequence[Observation], matcher: Matcher, loop_closures: LoopClosureVerifier, config: BuildingConfig
) -> None:
    """Let odometry begin anew, in the matcher's keyframes, at drives whose images say that it does.

    Costs a few thousand comparisons for each drive that goes on after a pause of more than `PAUSE_S`.
    """
    ordered, keyframes = sorted(observations, key=lambda seen: seen.step), matcher.keyframes
    frames = [seen.step for seen in ordered]
    for first in keyframes.resumed_starts:
        row = bisect_left(frames, first)
        if not 0 < row < len(frames) or ordered[row].stamp - ordered[row - 1].stamp <= PAUSE_S:
            continue
        own = [seen for seen in ordered if keyframes.drive_of(seen.step) == keyframes.drive_of(first)]
        before = [seen for seen in ordered if keyframes.drive_of(seen.step) == keyframes.drive_of(first) - 1]
        links = DriveLinkSearch([*before, *own], [first], matcher, loop_closures, config).links()
        if _contradict(links, OdometryGate([*before, *own], config)):
            log.warning("Images contradict that odometry goes on at image %d; only images join that drive.", first)
            keyframes.restart_odometry(first)


def _contradict(links: Sequence[DriveLink], gate: OdometryGate) -> bool:
    """Tell whether odometry allows fewer than half of the links."""
    allowed = [_is_allowed(link, gate) for link in links]
    return bool(links) and 2 * sum(allowed) < len(links)


def _is_allowed(link: DriveLink, gate: OdometryGate) -> bool:
    return bool(gate.plausible(link.frame, Matches.of_one(link.other, 1.0, link.waypoint)).all())
