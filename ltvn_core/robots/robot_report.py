"""Report of a robot that is checked before a drive: its topics, its camera's mounting, a short turn, known places.

Owns the rules and their limits. Doubts about the sequence of its observations are in `robots.robot_check`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.types import Depth

MOST_AGE_S = 0.3
LEAST_RECOGNISED = 0.5
"""Share of recognised images below which there is a finding."""
MOST_TILT_OFF_DEG = 3.0
_NEAR_FLOOR_M, _NEAR_FLOOR_SLOPE = 0.06, 0.08
"""Greatest height of floor points above or below the floor in the profile, in metres, and the increase of this limit
per metre ahead; it excludes the seat of a sofa."""
_ON_PLANE_M = 0.02
_TRIES = 300
"""Number of random planes through three points (RANSAC); the one with most points on it is the floor."""
_STEEPEST = 0.3
"""Greatest slope of a floor."""
_LEAST_EXTENT_M = 0.9
"""Least extent of nine tenths of the floor, ahead and across, in metres; excludes a strip of floor in front of a wall,
which lies on a plane with the foot of the wall."""
_FAR_M = 3.5
"""Range up to which depth cameras are accurate enough, in metres."""
_FEWEST_POINTS = 100
_MOSTLY = 0.65
"""Least share of points near the floor that must lie on it; with fewer, the plane is a wall's foot or furniture."""


@dataclass(frozen=True, slots=True)
class FloorFit:
    """Deviation of a camera from its profile, measured by the floor."""

    pitch_off_deg: float
    """Angle by which the camera looks higher than in its profile, in degrees."""
    roll_off_deg: float
    """Angle by which the camera's right side is lower than in its profile, in degrees."""
    height_off_m: float
    """Height of the camera above that in its profile, in metres."""


def fit_floor(depth: Depth, camera: CameraModel) -> FloorFit | None:
    """Return the deviation of a mounted camera from its profile; None if too little floor is visible."""
    points = camera.unproject_image(np.where(depth < _FAR_M, depth, 0))
    near = points[np.abs(points[:, 2]) < _NEAR_FLOOR_M + _NEAR_FLOOR_SLOPE * points[:, 0]]
    if len(near) < _FEWEST_POINTS:
        return None
    floor = near[_most_on_a_plane(near)]
    if len(floor) < max(_FEWEST_POINTS, _MOSTLY * len(near)):
        return None
    if np.ptp(np.percentile(floor[:, :2], (5, 95), axis=0), axis=0).min() < _LEAST_EXTENT_M:
        return None
    places = np.column_stack([floor[:, :2], np.ones(len(floor))])
    ahead, left, up_m = np.linalg.lstsq(places, floor[:, 2], rcond=None)[0]
    return FloorFit(
        pitch_off_deg=-float(np.degrees(np.arctan(ahead))),
        roll_off_deg=-float(np.degrees(np.arctan(left))),
        height_off_m=-float(up_m),
    )


def _most_on_a_plane(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (N, 3) lie on the plane with most points; none if every plane is too steep."""
    corners = points[np.random.default_rng(0).integers(0, len(points), (_TRIES, 3))]
    along = corners[:, 1] - corners[:, 0]
    across = corners[:, 2] - corners[:, 0]
    normals = np.cross(along, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = -normals[:, :2] / normals[:, 2:]
    usable = np.isfinite(slopes).all(axis=1) & (np.abs(slopes).max(axis=1) < _STEEPEST)
    if not usable.any():
        return np.zeros(len(points), bool)
    slopes, corners = slopes[usable], corners[usable, 0]
    begin = corners[:, 2] - (slopes * corners[:, :2]).sum(axis=1)
    on_plane = np.abs(points[:, 2] - slopes @ points[:, :2].T - begin[:, None]) < _ON_PLANE_M
    return on_plane[np.argmax(on_plane.sum(axis=1))]


@dataclass(frozen=True)
class TopicReport:
    """Measured traffic of one topic."""

    topic: str
    rate_hz: float
    """Rate of usable messages per second."""
    longest_gap_s: float | None
    """Longest time between two messages, in seconds; None if it was not measured."""
    publishers: tuple[str, ...]
    """Nodes that announce themselves as publishers."""


@dataclass(frozen=True)
class TurnReport:
    """Result of a short turn on the spot."""

    moves_after_s: float | None
    """Time from the command until odometry shows the turn, in seconds; None if the robot did not move."""
    stands_after_s: float | None
    """Time from the stop until odometry stands still, in seconds; None if the robot went on."""


@dataclass(frozen=True)
class PlaceSeen:
    """Localisation of one image in a map."""

    stamp_s: float
    """Time of the image, in seconds on the robot's clock."""
    node: int | None
    """The node at which the image is localised; None if there is none."""
    reachability: float
    """r of the best node, even if the image is not localised at it."""


@dataclass(frozen=True)
class PlacesReport:
    """Localisation of the images of a drive in a map."""

    images: tuple[PlaceSeen, ...]

    @property
    def recognised_share(self) -> float:
        """Share of the images that are localised at a node."""
        return sum(each.node is not None for each in self.images) / max(len(self.images), 1)

    def __str__(self) -> str:
        """Return one line with the number of recognised images and the sequence of nodes; ? stands for an image without
        a node.
        """
        nodes = ["?" if each.node is None else str(each.node) for each in self.images]
        way = [node for before, node in zip(["", *nodes], nodes, strict=False) if node != before]
        known = sum(each.node is not None for each in self.images)
        return f"{known} of {len(nodes)} images recognised, at the nodes {' '.join(way)}"


@dataclass(frozen=True)
class RobotReport(WithDoubts):
    """Results of the checks of a robot."""

    robot: str
    address: str
    topics: tuple[TopicReport, ...]
    image: str
    """Size of the images."""
    field_of_view_deg: tuple[float, float]
    """Horizontal and vertical field of view, in degrees."""
    depth_share: float
    """Share of pixels with depth."""
    age_s: float | None
    """Greatest age of the newest complete image, in seconds; None in a recording."""
    floor: FloorFit | None
    """Deviation of the camera from its profile; None if too little floor is visible."""
    commands_taken: bool
    """Whether the guard or the robot subscribes to commands."""
    driving: TurnReport | None
    """Result of a short turn; None if it was not allowed."""
    places: PlacesReport | None = None
    """Localisation in a map; None if no map was given."""
    findings: tuple[Finding, ...] = ()
    """Properties that are not good enough."""

    def with_places(self, places: PlacesReport) -> "RobotReport":
        """Return this report with the localisation of the robot, and a finding if most images are not recognised."""
        share = places.recognised_share
        if share >= LEAST_RECOGNISED:
            return replace(self, places=places)
        few = f"The map recognises only {share:.0%} of the images."
        finding = Finding(few if len(places.images) > 1 else "The map does not recognise what the robot sees now.")
        return replace(self, places=places, findings=(*self.findings, finding))


def robot_findings(report: RobotReport) -> Iterator[Finding]:
    """Yield what is not good enough in the images of any robot."""
    for each in report.topics:
        if len(each.publishers) > 1:
            yield Finding(f"{each.topic} has {len(each.publishers)} publishers.", where=each.topic)
    if report.age_s is not None and report.age_s > MOST_AGE_S:
        yield Finding(f"Images were up to {report.age_s:.2f} s old; is the network slow?", remedy="Send smaller ones.")
    off = 0.0 if report.floor is None else max(abs(report.floor.pitch_off_deg), abs(report.floor.roll_off_deg))
    if off > MOST_TILT_OFF_DEG:
        yield Finding(f"The floor seems tilted by {off:.1f} degrees: correct pitch_deg, roll_deg in the profile.")
