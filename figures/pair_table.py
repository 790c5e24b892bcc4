"""The pairs of a shard as a table, with explanations of failed criteria and waypoint outlines.

Owns the texts for each failed criterion, with the measured value and the limit, and the outline of a waypoint in an
image. Draws nothing.
"""

from dataclasses import dataclass, fields
from math import degrees
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.network.training_data.reachability_labels import FailedCriteria, ReachabilityLimits
from ltvn_core.network.training_data.shards import Shard
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Rgb, Waypoint

ROBOT_RADIUS_M = LOCOBOT.clear_radius_m
"""Radius of the ring that marks a waypoint."""

_NEAREST_M = 0.08
"""Points closer to the image plane than this are not projected."""


class WaypointOutline(NamedTuple):
    """Lines that mark a waypoint in an image: (K, 2) columns and rows in pixels, nan where they are not ahead."""

    ring: NDArray[np.float64]
    """Outline of the robot on the floor."""
    heading: NDArray[np.float64]
    """Line from the centre of the robot in the direction of its heading."""
    mast: NDArray[np.float64]
    """Line from the floor to the camera."""


def project(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the pixels (N, 2), columns and rows, of points (N, 3); nan for points behind the camera.

    Points are metres ahead of the camera, to its left, and above the floor.
    """
    near = points[:, 0] <= _NEAREST_M
    return np.where(near[:, None], np.nan, LOCOBOT.camera.project(points) + 0.5)


def waypoint_outline(waypoint: Waypoint) -> WaypointOutline:
    """Return the outline of a waypoint (3,) in the image of its source."""
    x, y, yaw = waypoint
    angles = yaw + np.linspace(0, 2 * np.pi, 33)
    ring = np.column_stack([x + ROBOT_RADIUS_M * np.cos(angles), y + ROBOT_RADIUS_M * np.sin(angles), 0 * angles])
    reach = 2.2 * ROBOT_RADIUS_M
    heading = np.array([[x, y, 0], [x + reach * np.cos(yaw), y + reach * np.sin(yaw), 0]])
    mast = np.array([[x, y, 0], [x, y, LOCOBOT.camera.height_m]])
    return WaypointOutline(ring=project(ring), heading=project(heading), mast=project(mast))


@dataclass(frozen=True, eq=False)
class LabelledPair:
    """One row of the table with its two images."""

    scene: str
    source: int
    """Row of the source image in its shard."""
    target: int
    """Row of the target image in its shard."""
    source_rgb: Rgb
    target_rgb: Rgb
    waypoint: Waypoint
    """(3,) true pose of the target in the source's frame."""
    reachable: bool
    failed: FailedCriteria
    overlap: float
    """Share of the target's points that the source sees; nan where not measured."""
    path_ratio: float
    """Ratio of the path length to the straight line; nan where not measured."""

    @property
    def distance_m(self) -> float:
        """Straight distance in metres."""
        return float(np.hypot(self.waypoint[0], self.waypoint[1]))


class PairTable:
    """All pairs of one shard."""

    def __init__(self, shard: Shard) -> None:
        self.shard = shard
        self.waypoints: Waypoint = relative(shard.poses[shard.sources], shard.poses[shard.targets])
        self.distance_m: NDArray[np.float64] = np.hypot(self.waypoints[:, 0], self.waypoints[:, 1])

    def pair(self, row: int) -> LabelledPair:
        """Return one pair with its images."""
        shard = self.shard
        i = int(shard.sources[row])
        j = int(shard.targets[row])
        return LabelledPair(
            scene=shard.name,
            source=i,
            target=j,
            source_rgb=shard.rgb[i],
            target_rgb=shard.rgb[j],
            waypoint=self.waypoints[row],
            reachable=bool(shard.reachable[row]),
            failed=FailedCriteria(int(shard.failed[row])),
            overlap=float(shard.overlap[row]),
            path_ratio=float(shard.path_ratio[row]),
        )


@dataclass(frozen=True, slots=True)
class FailureExplanation:
    """One failed criterion and its explanation."""

    criterion: FailedCriteria
    text: str

    @property
    def name(self) -> str:
        """Name of the criterion in lower case."""
        return criterion_name(self.criterion)


def criterion_name(criterion: FailedCriteria) -> str:
    """Return a criterion's name in lower case."""
    return (criterion.name or str(int(criterion))).lower()


def single_criteria() -> tuple[FailedCriteria, ...]:
    """Return all single criteria."""
    return tuple(each for each in FailedCriteria if each)


def reasons(pair: LabelledPair, limits: ReachabilityLimits) -> tuple[FailureExplanation, ...]:
    """Return an explanation for each criterion that the pair fails."""
    return tuple(
        FailureExplanation(each, _text(each, pair, limits)) for each in single_criteria() if each & pair.failed
    )


def limits_from_recipe(recipe: str) -> ReachabilityLimits:
    """Return the limits in a shard's recipe; the defaults if it has none."""
    try:
        found = parse_json(recipe)["limits"]
    except (ValueError, KeyError, TypeError):
        return ReachabilityLimits()
    known = {field.name for field in fields(ReachabilityLimits)}
    return ReachabilityLimits(**{name: float(value) for name, value in found.items() if name in known})


def _text(criterion: FailedCriteria, pair: LabelledPair, limits: ReachabilityLimits) -> str:
    match criterion:
        case FailedCriteria.DISTANCE:
            return f"{pair.distance_m:.2f} m apart, at most {limits.distance_m:.2f} m are allowed"
        case FailedCriteria.YAW:
            turn = abs(degrees(pair.waypoint[2]))
            most = degrees(limits.yaw_rad)
            return f"turned by {turn:.0f}°, at most {most:.0f}° are allowed"
        case FailedCriteria.VISIBILITY:
            return _visibility_text(pair)
        case FailedCriteria.OVERLAP:
            return (
                f"the source sees {pair.overlap:.0%} of the target's points, more than {limits.overlap:.0%} are needed"
            )
        case FailedCriteria.PATH:
            return _path_text(pair.path_ratio, limits.path_ratio)
        case FailedCriteria.LINE:
            return f"something stands within {limits.line_clearance_m:.2f} m of the straight line"
        case _:
            return "fails this criterion"


def _visibility_text(pair: LabelledPair) -> str:
    if pair.waypoint[0] <= 0:
        return "the target's place lies behind the source"
    return "the target's place is hidden or outside the image"


def _path_text(ratio: float, limit: float) -> str:
    if not np.isfinite(ratio):
        return f"the path is far longer than {limit:.2f} times the straight line"
    return f"the path is {ratio:.2f} times the straight line, at most {limit:.2f} are allowed"
