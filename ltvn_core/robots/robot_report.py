"""What is seen of a robot that is looked over before it is driven. Owns what counts as good enough to navigate by."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ltvn_core.robots.floor_fit import FloorFit

MOST_AGE_S = 0.3
LEAST_RECOGNISED = 0.5
"""Of the images that a map is asked about."""
MOST_TILT_OFF_DEG = 3.0


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
class DriveReport:
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
class RobotReport:
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
    driving: DriveReport | None
    """What a short turn showed, where it was allowed."""
    places: PlacesReport | None = None
    """Where it is in a map, where somebody named one."""
    doubts: tuple[str, ...] = ()
    """What is not good enough, in words."""


def with_places(report: RobotReport, places: PlacesReport) -> RobotReport:
    """Return a report with where the robot is, and a doubt where that is unknown for the most part."""
    share = places.recognised_share
    if share >= LEAST_RECOGNISED:
        return replace(report, places=places)
    few = f"The map recognises only {share:.0%} of the images."
    doubt = few if len(places.images) > 1 else "The map does not recognise what the robot sees now."
    return replace(report, places=places, doubts=(*report.doubts, doubt))


def report_doubts(report: RobotReport) -> Iterator[str]:
    """Yield what is not good enough of the images of any robot, in words."""
    for each in report.topics:
        if len(each.publishers) > 1:
            yield f"{each.topic} has {len(each.publishers)} publishers."
    if report.age_s is not None and report.age_s > MOST_AGE_S:
        yield f"Images were up to {report.age_s:.2f} s old; is the network slow? Send smaller ones."
    off = 0.0 if report.floor is None else max(abs(report.floor.pitch_off_deg), abs(report.floor.roll_off_deg))
    if off > MOST_TILT_OFF_DEG:
        yield f"The floor seems tilted by {off:.1f} degrees: correct pitch_deg, roll_deg in the profile."
