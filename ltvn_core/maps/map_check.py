"""Findings about a map: its problems, and their likely causes in the drive that it was built from.

Owns the checks, their limits and the advice. Compares some consecutive images, because these are the most likely to be
near each other. Decides nothing: a doubtful map is kept and can be driven by.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.image_similarity import colour_descriptors
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.rectification import Rectification, have_same_rays
from ltvn_core.data.revisits import near_pairs, revisits
from ltvn_core.findings import Finding
from ltvn_core.geometry import relative
from ltvn_core.graph.corrections import LOOK_ALIKES, UNSURE, Correction, UnsurePlaces
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.planner import strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.map_coverage import MapCoverage, evenly
from ltvn_core.types import Features, FrameId, Observation, Predictor, is_usable

MANY_NODES = 6
SMALL_PIECE = 0.5
"""Least number of nodes of a map that is checked for pieces, and share of its nodes below which its largest piece is
too small."""
MANY_IMAGES = 20
"""Number of images of a two-metre drive; a shorter drive may show a single place."""
LITTLE_KNOWN = 0.8
"""Share of its own drive that a map should know; with less, the robot is lost on the rest."""
MUCH_BY_ODOMETRY = 0.25
"""Share of its own drive that a map knows only because odometry holds its pieces together, above which it says so."""
PAIRS = 30
"""Number of pairs of consecutive images that are compared, spread over the drive."""
RECOGNISED = 0.5
"""Value of r above which two images count as recognised."""
FEW_RECOGNISED = 0.5
"""Share of recognised pairs below which the predictor is the likely cause of a map in pieces."""
MOST_RECOGNISED = 0.95
"""Share of recognised pairs below which the drive is said to break at the pairs that are not recognised."""
GEOMETRIC = "geometric"
"""Predictor to suggest, unless it was used."""
SEEN = 0.6
"""Share of the predictor's field of view that a camera should show."""
MOST_WITHOUT_DEPTH = 0.5
ALIKE = 0.97
"""Similarity of images far apart in time above which images look alike throughout the drive."""
FEW_KEY_POINTS = 150
"""Number of key points per image below which a predictor that compares key points finds too little."""
MOST_UNSURE = 0.25
"""Share of the images whose place may be unsure."""
MOST_ONE_WAY = 0.5
"""Share of the images unknown to a map that must have one cause for it to be reported."""
NO_WAY_M, NO_TURN_RAD = 0.5, math.radians(15)
"""Extent of a drive, in metres and radians, below which it shows a single place."""


@runtime_checkable
class KeyPointPredictor(Protocol):
    """A predictor that compares images by key points."""

    def key_point_counts(self, features: Features) -> NDArray[np.intp]:
        """Return the number of key points of each of N images, (N,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MappedDrive:
    """A drive and the map that was built from it."""

    observations: Sequence[Observation]
    """The observations as they were recorded, in the order of their steps."""
    camera: CameraModel | None
    """Camera that took them; None if it is the predictor's."""
    is_lens_known: bool
    """Whether the lens of that camera was given."""
    graph: TopologicalGraph
    keyframes: KeyframeStore
    """The images as the predictor sees them."""
    predictor: Predictor
    predictor_name: str = ""
    """Name by which the predictor was chosen; empty if it has none."""
    least_width_px: int = 0
    """Width of images below which the predictor finds too little, in pixels."""


def map_findings(graph: TopologicalGraph, images: int, coverage: MapCoverage) -> tuple[Finding, ...]:
    """Return the problems of a map; none if the map is in order or was built from fewer than two images.

    Args:
        graph: The map.
        images: Number of images that it was built from.
        coverage: Share of these images that the map knows.
    """
    if images < 2:
        return ()
    return (*_joints(graph, images, coverage), *_coverage(coverage))


def _joints(graph: TopologicalGraph, images: int, coverage: MapCoverage) -> Iterator[Finding]:
    """Yield the problems that nodes and edges alone show."""
    if len(graph.nodes) == 1:
        yield _one_node(images, coverage)
    elif len(graph.nodes) > 1 and not graph.edges:
        yield Finding(
            f"None of the {len(graph.nodes)} nodes is joined to another, so the map cannot be used for navigation. "
            "Are the images far apart, or the weights trained for another camera?"
        )
    elif len(graph.nodes) >= MANY_NODES:
        pieces = strongly_connected_components(graph)
        if len(pieces[0]) < SMALL_PIECE * len(graph.nodes):
            yield Finding(
                f"The map falls into {len(pieces)} pieces, the largest with {len(pieces[0])} of {len(graph.nodes)} "
                "nodes, and no path leads from one piece to another.",
                remedy="Drive the routes between them too, slowly and in both directions.",
            )


def _one_node(images: int, coverage: MapCoverage) -> Finding:
    text = "The map has only one node, so it cannot be used for navigation."
    if coverage.share < LITTLE_KNOWN:
        return Finding(text)  # Most images show something else; the finding about the coverage gives their number.
    if images < MANY_IMAGES:
        return Finding(f"{text} It was built from {images} images of one place; drive farther.")
    share = "all" if coverage.share == 1 else "nearly all"
    return Finding(
        f"{text} {share} {images} images seem to show the same place: does the camera work, and is it the one that "
        "the weights were trained for?"
    )


def _coverage(coverage: MapCoverage) -> Iterator[Finding]:
    if coverage.share - coverage.by_images >= MUCH_BY_ODOMETRY:
        yield Finding(
            "Odometry holds the map together: by recognised images alone, its largest piece knows "
            f"{coverage.by_images:.0%} of its own drive instead of {coverage.share:.0%}. Where odometry is wrong, so "
            "are those edges.",
            remedy="Drive the places between again slowly, in both directions.",
        )
    if coverage.share >= LITTLE_KNOWN:
        return
    text = (
        f"The map knows {coverage.share:.0%} of its own drive: the other images are neither nodes of its largest "
        "piece nor recognised as such a node, so the robot will be lost there."
    )
    if coverage.gap is None:
        yield Finding(text, remedy="Drive there again, slowly.")
        return
    gap = coverage.gap
    longest = f"The longest such part is from {gap.begin_s:.1f} s to {gap.end_s:.1f} s of {gap.drive or 'the drive'};"
    yield Finding(f"{text} {longest} drive it again, slowly.", where=gap.drive)


def diagnose(drive: MappedDrive, coverage: MapCoverage) -> tuple[Finding, ...]:
    """Return the problems of a map, then their likely causes in the drive; nothing for a map in order."""
    doubtful = map_findings(drive.graph, len(drive.observations), coverage)
    if not doubtful:
        return ()
    recognised = _recognised_in_a_row(drive)
    return (
        *doubtful,
        *(finding for check in _CAUSES for finding in check(drive)),
        *_overlap(drive, recognised),
        *_one_way(drive, coverage, recognised),
    )


def place_findings(corrections: Sequence[Correction], places: UnsurePlaces | None, images: int) -> Iterator[Finding]:
    """Yield how many images have no sure place, if these are many and some places look alike."""
    count_of = {each.what: each.count for each in corrections}
    unsure, alike = count_of.get(UNSURE, 0), count_of.get(LOOK_ALIKES, 0)
    if places and alike and unsure > MOST_UNSURE * images:
        first, last = places.longest
        yield Finding(
            f"{alike} pairs of images look alike but show different places, and {unsure / images:.0%} of all images "
            f"are placed less surely than 1 m, so that more such places may be confused. {places}.",
            remedy=f"Drive once more from image {first:,} to image {last:,}, in a round that comes back to many "
            "places, and build the map from both drives.",
        )


def _cause(text: str, remedy: str = "") -> Finding:
    return Finding(f"Likely cause: {text}", remedy=remedy)


def _lens(drive: MappedDrive) -> Iterator[Finding]:
    if not drive.is_lens_known:
        yield _cause(
            "the lens is unknown, so a field of view was assumed.",
            "Import the drive again and give the lens with --camera, or roughly with --fov.",
        )


def _depth(drive: MappedDrive) -> Iterator[Finding]:
    without = sum(not seen.has_depth for seen in drive.observations)
    if without > MOST_WITHOUT_DEPTH * len(drive.observations):
        yield _cause(
            f"{without} of {len(drive.observations)} images have no depth, so their distances are guessed, or they "
            "are left out.",
            "Record the depth camera too.",
        )


def _size(drive: MappedDrive) -> Iterator[Finding]:
    width_px = drive.predictor.camera.width
    if width_px < drive.least_width_px:
        yield _cause(
            f"the images are {width_px} pixels wide, but the predictor needs at least {drive.least_width_px}.",
            "Record larger images, or use --predictor network.",
        )


def _key_points(drive: MappedDrive) -> Iterator[Finding]:
    frames = [seen.step for seen in drive.observations if seen.step in drive.keyframes]
    if not isinstance(drive.predictor, KeyPointPredictor) or not frames:
        return
    usual = float(np.median(drive.predictor.key_point_counts(drive.keyframes.features(evenly(frames, PAIRS)))))
    if usual < FEW_KEY_POINTS:
        yield _cause(
            f"few key points ({usual:.0f} per image, but at least {FEW_KEY_POINTS} are few): the images are small, "
            "dark, blurred or show bare walls.",
            "Turn the camera to things with texture, give more light, and keep images closer together: drive slower, "
            f"or {_thin_less(drive)}.",
        )


def _view(drive: MappedDrive) -> Iterator[Finding]:
    """Check how much of the predictor's field of view the camera shows."""
    camera = drive.camera
    target = drive.predictor.camera
    if camera is None or have_same_rays(camera, target):
        return
    tilts = [seen.tilt for seen in drive.observations if seen.tilt is not None]
    if tilts:
        pitch, roll = (float(np.median(angles)) for angles in np.array(tilts).T)
        camera = replace(camera, pitch_rad=pitch, roll_rad=roll)
    seen = float(Rectification(camera, target).seen.mean())
    if seen < SEEN:
        yield _cause(
            f"the predictor's camera is level and {math.degrees(target.horizontal_fov_rad):.0f} degrees wide, the "
            f"drive's is pitched by {math.degrees(camera.pitch_rad):.0f} and "
            f"{math.degrees(camera.horizontal_fov_rad):.0f} degrees wide, so it sees {seen:.0%} of what it needs.",
            "Use --predictor geometric, which takes any camera, or mount the camera nearly level.",
        )


def _places(drive: MappedDrive) -> Iterator[Finding]:
    """Check whether the drive shows more than one place."""
    poses = np.array([seen.odometry for seen in drive.observations])
    way = relative(poses[0], poses)
    moved_m = np.hypot(way[:, 0], way[:, 1]).max()
    turned_rad = np.abs(way[:, 2]).max()
    if _has_odometry(drive) and moved_m < NO_WAY_M and turned_rad < NO_TURN_RAD:
        yield _cause(
            f"by its odometry the robot stayed within {NO_WAY_M} m and hardly turned.",
            "Drive farther, or give odometry in metres and radians.",
        )
    if _look_alike(drive):
        yield _cause(
            "all images look alike. Is the camera covered, or does it see only the robot itself, a bare wall or the "
            "floor?",
            "Point it at things that differ between places.",
        )


_CAUSES = (_lens, _depth, _size, _key_points, _view, _places)


def _look_alike(drive: MappedDrive) -> bool:
    """Tell whether images far apart in time resemble each other throughout the drive."""
    frames = [seen.step for seen in drive.observations if seen.step in drive.keyframes]
    if len(frames) < 2:
        return False
    places = np.linspace(0, len(frames) - 1, min(PAIRS, len(frames))).astype(int)
    likeness = colour_descriptors(drive.keyframes, [frames[place] for place in places])
    apart = np.abs(np.subtract.outer(places, places)) > len(frames) // 3
    return float(np.median((likeness @ likeness.T)[apart])) > ALIKE


def _overlap(drive: MappedDrive, recognised: NDArray[np.bool_] | None) -> Iterator[Finding]:
    """Check whether most of P pairs of consecutive images are `recognised` (P,), and whether they overlap enough."""
    if recognised is None or recognised.mean() >= MOST_RECOGNISED:
        return
    text = f"{recognised.sum()} of {len(recognised)} pairs of consecutive images are recognised as the same place"
    if recognised.mean() >= FEW_RECOGNISED:
        yield _cause(
            f"{text}; where a pair is not, the map may fall into pieces.",
            "Look at those images (`ltvn view`). In turns, near bare walls or in the dark, drive slower, record more "
            f"images per second, or {_thin_less(drive)}.",
        )
        return
    apart = _far_apart(drive)
    if _has_odometry(drive) and apart > FEW_RECOGNISED / 2:
        yield _cause(
            f"{text}, because they hardly overlap: {apart:.0%} are farther than 1 m or turned by half of the field of "
            "view.",
            f"Drive slower, record more images per second, or {_thin_less(drive)}.",
        )
        return
    other = "" if drive.predictor_name == GEOMETRIC else f"try --predictor {GEOMETRIC}, "
    yield _cause(
        f"{text}. The predictor cannot compare images of this camera, or they do not overlap: {other}adapt it with "
        "`ltvn finetune`, and check consecutive images for blur and gaps (`ltvn view`)."
    )


def _thin_less(drive: MappedDrive) -> str:
    if _has_odometry(drive):
        return "thin less (--every-m, --every-deg of `ltvn import`)"
    return "keep all images (--every-m 0 --every-deg 0 of `ltvn import`)"


def _one_way(drive: MappedDrive, coverage: MapCoverage, recognised: NDArray[np.bool_] | None) -> Iterator[Finding]:
    """Check whether most images that the map does not know can be joined in one direction only."""
    if not coverage.lost or recognised is None or recognised.mean() < FEW_RECOGNISED:
        return  # If consecutive images are not recognised, a second pass would not be recognised either.
    again = "Drive there again slowly, in both directions."
    once = _passed_once(drive, coverage.lost)
    if once >= MOST_ONE_WAY * len(coverage.lost):
        yield _cause(
            f"one direction only. {once} of the {len(coverage.lost)} images that the map does not know were taken "
            "where the drive passes once and in one direction.",
            again,
        )
        return
    single, asked = _recognised_one_way(drive, coverage.lost)
    if asked and single >= MOST_ONE_WAY * asked:
        yield _cause(
            f"one direction only. {single} of {asked} images that the map does not recognise see a node ahead or are "
            "seen from a node, but not both.",
            again,
        )


def _passed_once(drive: MappedDrive, lost: Sequence[FrameId]) -> int:
    """Return how many of the lost images were taken where the drive passes only once, by odometry; 0 if that is
    unknown."""
    if not _has_odometry(drive) or len(drive.graph.drives) > 1:
        return 0
    poses = np.array([seen.odometry for seen in drive.observations])
    stamps = np.array([seen.stamp for seen in drive.observations])
    passed_again = {drive.observations[row].step for row in revisits(near_pairs(poses), poses, stamps).ravel().tolist()}
    return sum(frame not in passed_again for frame in lost)


def _recognised_one_way(drive: MappedDrive, lost: Sequence[FrameId]) -> tuple[int, int]:
    """Return how many lost images are recognised in only one direction by the nodes next to them in time, and how many
    were compared."""
    nodes = np.array(sorted(drive.graph.nodes))
    held = [frame for frame in lost if frame in drive.keyframes and frame not in drive.graph.nodes]
    held = [frame for frame in held if is_usable(drive.keyframes.observation(frame), drive.predictor)]
    asked = evenly(held, PAIRS)
    if not asked or not len(nodes):
        return 0, 0
    after = np.searchsorted(nodes, asked)
    beside = nodes[np.clip([after - 1, after], 0, len(nodes) - 1)].ravel().tolist()
    images = drive.keyframes.features([*asked, *asked])
    targets = drive.keyframes.features(beside)
    there = drive.predictor.predict(images, targets).reachability.reshape(2, -1) > RECOGNISED
    back = drive.predictor.predict(targets, images).reachability.reshape(2, -1) > RECOGNISED
    return int(((there | back).any(axis=0) & ~(there & back).any(axis=0)).sum()), len(asked)


def _far_apart(drive: MappedDrive) -> float:
    """Return the share of consecutive images that, by odometry, can hardly overlap."""
    poses = np.array([seen.odometry for seen in drive.observations])
    steps = relative(poses[:-1], poses[1:])
    moved_m = np.hypot(steps[:, 0], steps[:, 1])
    turned_rad = np.abs(steps[:, 2])
    camera = drive.camera or drive.predictor.camera
    return float(((moved_m > 1.0) | (turned_rad > camera.horizontal_fov_rad / 2)).mean())


def _has_odometry(drive: MappedDrive) -> bool:
    return bool(np.ptp([seen.odometry for seen in drive.observations], axis=0).any())


def _recognised_in_a_row(drive: MappedDrive) -> NDArray[np.bool_] | None:
    """Return for some pairs of consecutive images (P,) whether the predictor calls them one place in either
    direction."""
    frames = [seen.step for seen in drive.observations if seen.step in drive.keyframes]
    frames = [frame for frame in frames if is_usable(drive.keyframes.observation(frame), drive.predictor)]
    if len(frames) < 2:
        return None
    places = evenly(range(len(frames) - 1), PAIRS)
    first = drive.keyframes.features([frames[place] for place in places])
    second = drive.keyframes.features([frames[place + 1] for place in places])
    there = drive.predictor.predict(first, second)
    back = drive.predictor.predict(second, first)
    return np.maximum(there.reachability, back.reachability) > RECOGNISED
