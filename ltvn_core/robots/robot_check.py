"""What cannot be right of a robot: of its observations, one after the other, and of the robot when it is looked over.

Owns the rules, their limits, and the report of a robot that is looked over before it is driven. What is wrong with one
observation alone is refused at the door (`ltvn_core.preprocessing`); here it is told and kept, because a person may
know better.
"""

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.findings import Finding, WithDoubts
from ltvn_core.types import Depth, Observation, Pose

_NEAR_FLOOR_M, _NEAR_FLOOR_SLOPE = 0.06, 0.08
"""What is so near to the floor as the profile has it may be floor, and the more the farther ahead it is; the seat of a
sofa is not."""
_ON_PLANE_M = 0.02
_TRIES = 300
"""So many planes through three points are tried; the one with most points on it is the floor."""
_STEEPEST = 0.3
"""No floor rises more than this, as a slope."""
_LEAST_EXTENT_M = 0.9
"""Of nine tenths of the floor, ahead and across: a strip before a wall and the foot of the wall lie on a plane, too."""
_FAR_M = 3.5
"""Depth cameras are too inaccurate beyond."""
_FEWEST_POINTS = 100
_MOSTLY = 0.65
"""So much of what is near the floor must be floor, or it is the foot of a wall, or furniture."""


@dataclass(frozen=True, slots=True)
class FloorFit:
    """What the floor says against a profile."""

    pitch_off_deg: float
    """The camera looks so much higher than its profile says."""
    roll_off_deg: float
    """Its right side is so much lower than its profile says."""
    height_off_m: float
    """It stands so much higher than its profile says."""


def fit_floor(depth: Depth, camera: CameraModel) -> FloorFit | None:
    """Return how far a camera at its place on the robot is off; None where too little floor is seen."""
    points = camera.unproject_image(np.where(depth < _FAR_M, depth, 0))
    near = points[np.abs(points[:, 2]) < _NEAR_FLOOR_M + _NEAR_FLOOR_SLOPE * points[:, 0]]
    if len(near) < _FEWEST_POINTS:
        return None
    floor = near[_most_on_a_plane(near)]
    if len(floor) < max(_FEWEST_POINTS, _MOSTLY * len(near)) or _extent(floor) < _LEAST_EXTENT_M:
        return None
    ahead, left, up_m = np.linalg.lstsq(_columns(floor), floor[:, 2], rcond=None)[0]
    return FloorFit(
        pitch_off_deg=-float(np.degrees(np.arctan(ahead))),
        roll_off_deg=-float(np.degrees(np.arctan(left))),
        height_off_m=-float(up_m),
    )


def _extent(floor: NDArray[np.float64]) -> float:
    low, high = np.percentile(floor[:, :2], (5, 95), axis=0)
    return float((high - low).min())


def _most_on_a_plane(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which points (N, 3) lie on the plane that most of them lie on; none where every plane is steep."""
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


def _columns(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([points[:, :2], np.ones(len(points))])


JUMP_M = 50.0
"""Two images in a row are never so far apart. Larger than the buildings of the simulator, because it may put its robot
anywhere between two queries; what a robot drives between two images is less than a metre."""
SAME_STAMPS = 5
"""So many images in a row at one time mean a clock that stands still; a simulated robot that is put elsewhere has 2."""
ALIKE_IMAGES = 20
"""So many images in a row that are equal in every pixel; a camera that works has noise, and a simulated one moves."""
ALIKE_TRAVEL_M = 1.0
"""And the robot drove so far meanwhile, for whoever stands still may well see the same."""
MOST_AGE_S = 0.3
LEAST_RECOGNISED = 0.5
"""Of the images that a map is asked about."""
MOST_TILT_OFF_DEG = 3.0


class _Doubt(Enum):
    """A rule; each speaks once."""

    REPEATED_STEP = auto()
    BACKWARD_STEP = auto()
    BACKWARD_STAMP = auto()
    STANDING_CLOCK = auto()
    JUMP = auto()
    ALIKE = auto()


class ObservationCheck:
    """The check of one robot or of one recording."""

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self._last: Observation | None = None
        self._told: set[_Doubt] = set()
        self._same_stamps = 1
        self._checksum = 0
        self._alike = 1
        self._alike_since: Pose = np.zeros(3)

    def findings(self, observation: Observation) -> list[Finding]:
        """Return what is doubtful of the next observation; each rule speaks at its first breach alone."""
        before, self._last = self._last, observation
        if before is None:
            self._begin_alike(observation)
            return []
        if _is_same(before, observation):
            return []
        found = [*self._order(before, observation), *self._motion(before, observation), *self._pictures(observation)]
        fresh = [(rule, finding) for rule, finding in found if rule not in self._told]
        self._told.update(rule for rule, _ in fresh)
        return [finding for _, finding in fresh]

    def _order(self, before: Observation, now: Observation) -> Iterator[tuple[_Doubt, Finding]]:
        if now.step == before.step:
            text = f"Step {now.step} came twice, and only its first image can be kept; count on."
            yield _Doubt.REPEATED_STEP, Finding(text)
        elif now.step < before.step:
            text = f"Step {now.step} comes after step {before.step}; steps count on, also when a robot restarts."
            yield _Doubt.BACKWARD_STEP, Finding(text)
        if now.stamp < before.stamp:
            text = f"At step {now.step} the clock goes back from {before.stamp:.3f} s to {now.stamp:.3f} s."
            yield _Doubt.BACKWARD_STAMP, Finding(text, remedy="Use one clock that only goes on.")
        self._same_stamps = self._same_stamps + 1 if now.stamp == before.stamp else 1
        if self._same_stamps >= SAME_STAMPS:
            text = f"The last {SAME_STAMPS} images up to step {now.step} have the stamp {now.stamp:.3f} s."
            yield _Doubt.STANDING_CLOCK, Finding(f"{text} Does the robot's clock stand still?")

    def _motion(self, before: Observation, now: Observation) -> Iterator[tuple[_Doubt, Finding]]:
        moved_m = float(np.hypot(*(now.odometry - before.odometry)[:2]))
        if moved_m > JUMP_M:
            text = f"Odometry jumps by {moved_m:,.0f} m at step {now.step}; is it in metres, and does it restart?"
            yield _Doubt.JUMP, Finding(text)

    def _pictures(self, now: Observation) -> Iterator[tuple[_Doubt, Finding]]:
        if _checksum(now) != self._checksum:
            self._begin_alike(now)
            return
        self._alike += 1
        driven_m = float(np.hypot(*(now.odometry - self._alike_since)[:2]))
        if self._alike >= ALIKE_IMAGES and driven_m >= ALIKE_TRAVEL_M:
            text = f"The last {self._alike} images up to step {now.step} are equal, though the robot drove"
            yield _Doubt.ALIKE, Finding(f"{text} {driven_m:.1f} m; does the camera stand still, or is it covered?")

    def _begin_alike(self, observation: Observation) -> None:
        self._checksum = _checksum(observation)
        self._alike = 1
        self._alike_since = observation.odometry


def sequence_findings(observations: Iterable[Observation]) -> tuple[Finding, ...]:
    """Return what is doubtful of a whole drive, in the order in which it was taken."""
    check = ObservationCheck()
    return tuple(finding for observation in observations for finding in check.findings(observation))


def _is_same(before: Observation, now: Observation) -> bool:
    """Tell whether a robot handed out the same observation again, as it may within a control step."""
    return now is before or (
        now.step == before.step and now.stamp == before.stamp and np.array_equal(now.odometry, before.odometry)
    )


def _checksum(observation: Observation) -> int:
    return zlib.crc32(np.ascontiguousarray(observation.rgb).data)


@dataclass(frozen=True)
class TopicReport:
    """What one topic does."""

    topic: str
    rate_hz: float
    """Messages a second that could be used."""
    longest_gap_s: float | None
    """None where nobody counted."""
    publishers: tuple[str, ...]
    """Nodes that say they send it."""


@dataclass(frozen=True)
class TurnReport:
    """What came of a short turn on the spot."""

    moves_after_s: float | None
    """From the command until odometry shows it; None where the robot did not move."""
    stands_after_s: float | None
    """From the stop until odometry stands still; None where it went on."""


@dataclass(frozen=True)
class PlaceSeen:
    """Where a map takes an image to be."""

    stamp_s: float
    """On the robot's clock."""
    node: int | None
    """None where it is nowhere in the map."""
    reachability: float
    """r of the best node, whether it is near enough or not."""


@dataclass(frozen=True)
class PlacesReport:
    """Where a map takes images of a drive to be."""

    images: tuple[PlaceSeen, ...]

    @property
    def recognised_share(self) -> float:
        """Share of the images that are somewhere in the map."""
        return sum(each.node is not None for each in self.images) / max(len(self.images), 1)

    def __str__(self) -> str:
        """Say it in one line: how many, and the way through the map, where ? is nowhere."""
        nodes = ["?" if each.node is None else str(each.node) for each in self.images]
        way = [node for before, node in zip(["", *nodes], nodes, strict=False) if node != before]
        known = sum(each.node is not None for each in self.images)
        return f"{known} of {len(nodes)} images recognised, at the nodes {' '.join(way)}"


@dataclass(frozen=True)
class RobotReport(WithDoubts):
    """What was seen of a robot."""

    robot: str
    address: str
    topics: tuple[TopicReport, ...]
    image: str
    """Size of its pictures."""
    field_of_view_deg: tuple[float, float]
    """Across and down."""
    depth_share: float
    """Share of pixels with depth."""
    age_s: float | None
    """How old the newest whole image was, at worst; None where it was recorded."""
    floor: FloorFit | None
    """How far the camera is off; None where no floor is seen."""
    commands_taken: bool
    """Whether anybody listens to commands: the guard, or the robot."""
    driving: TurnReport | None
    """What a short turn showed, where it was allowed."""
    places: PlacesReport | None = None
    """Where it is in a map, where somebody named one."""
    findings: tuple[Finding, ...] = ()
    """What is not good enough."""

    def with_places(self, places: PlacesReport) -> "RobotReport":
        """Return this report with where the robot is, and a finding where that is unknown for the most part."""
        share = places.recognised_share
        if share >= LEAST_RECOGNISED:
            return replace(self, places=places)
        few = f"The map recognises only {share:.0%} of the images."
        finding = Finding(few if len(places.images) > 1 else "The map does not recognise what the robot sees now.")
        return replace(self, places=places, findings=(*self.findings, finding))


def robot_findings(report: RobotReport) -> Iterator[Finding]:
    """Yield what is not good enough of the images of any robot."""
    for each in report.topics:
        if len(each.publishers) > 1:
            yield Finding(f"{each.topic} has {len(each.publishers)} publishers.", where=each.topic)
    if report.age_s is not None and report.age_s > MOST_AGE_S:
        yield Finding(f"Images were up to {report.age_s:.2f} s old; is the network slow?", remedy="Send smaller ones.")
    off = 0.0 if report.floor is None else max(abs(report.floor.pitch_off_deg), abs(report.floor.roll_off_deg))
    if off > MOST_TILT_OFF_DEG:
        yield Finding(f"The floor seems tilted by {off:.1f} degrees: correct pitch_deg, roll_deg in the profile.")
