"""Evidence for and against a pose between two images, and the probability that the pose is right.

Owns the evidence of key points (how many agree, how they are spread, and whether another pose would fit as well) and of
surfaces (whether the coarse depth images and their colours agree).

Logistic regressions weigh the evidence: one for pairs with depth in both images, one for depth in one image, and one
for no depth. Owns their weights and the file format. `tools/fit_geometric.py` fitted the ones in the package;
`geometric_adaptation` adapts them to a drive.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.errors import DriveError, WeightsError
from ltvn_core.predictors.geometric_features import GRID_STEP_PX, ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_pose import ROOM_DEPTH_M, CameraMotion, PointPairs, points
from ltvn_core.structured_text import parse_json

DEPTH_TOLERANCE, DEPTH_TOLERANCE_M = 0.05, 0.04
"""Tolerance of agreeing depths: a share of the depth, plus a constant in metres."""

_MIN_SURFACE = 30
_SURFACE_STEP = 3
"""Step between compared points of the coarse depth image; it should not divide the length of a row."""
_COLOUR_TOLERANCE = 30.0
_MAX_COLOUR_GAP = 40.0


class ColourDifference(NamedTuple):
    """Colour difference of surfaces that should be the same."""

    conflict: float
    """Share of the points with a clearly different colour."""
    gap: float
    """Mean difference, on a scale of 0 to 255."""


class SurfaceAgreement(NamedTuple):
    """Agreement of the surface in one image with the depth image of the other."""

    visible: float
    agreeing: float
    conflicting: float
    brightness: float
    colours: ColourDifference


NO_SURFACE = SurfaceAgreement(0.0, 0.0, 0.0, 0.0, ColourDifference(0.0, 0.0))
"""Result if the images share too little surface."""


def surface_agreement(
    first: ImageFeatures, second: ImageFeatures, motion: CameraMotion, camera: CameraModel, grid: ImageGrid
) -> SurfaceAgreement:
    """Return the agreement of the first image's surface points with the second's coarse depth image after a motion."""
    chosen = np.arange(0, len(first.grid_depth), _SURFACE_STEP)
    chosen = chosen[first.grid_depth[chosen] > 0]
    there = motion.apply(points(grid.rays[chosen], first.grid_depth[chosen]))
    places, inside = _grid_places(there, camera, grid)
    if np.count_nonzero(inside) < _MIN_SURFACE:
        return NO_SURFACE
    places, expected, chosen = places[inside], there[inside, 2], chosen[inside]
    seen = second.grid_depth[places]
    known = seen > 0
    tolerance = DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * expected
    agreeing = known & (np.abs(seen - expected) < tolerance)
    conflicting = known & (seen > expected + 2 * tolerance)
    alike = agreeing if known.any() else ~known
    return SurfaceAgreement(
        visible=len(places) * _SURFACE_STEP / len(grid.rays),
        agreeing=float(agreeing.sum() / max(known.sum(), 1)),
        conflicting=float(conflicting.sum() / max(known.sum(), 1)),
        brightness=_correlation(_gray(first.grid_rgb[chosen[alike]]), _gray(second.grid_rgb[places[alike]])),
        colours=_colour_difference(first.grid_rgb[chosen[alike]], second.grid_rgb, places[alike], grid),
    )


def _grid_places(
    there: NDArray[np.float64], camera: CameraModel, grid: ImageGrid
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the nearest grid point (N,) of each point (N, 3), and whether it lies in the image (N,)."""
    ahead = there[:, 2] > 0.1
    rays = there[:, :2] / np.where(ahead, there[:, 2], 1)[:, None]
    pixels = np.nan_to_num(camera.rays_to_pixels(rays), nan=-1e6)
    columns, rows = np.rint((np.clip(pixels, -1e6, 1e6) - GRID_STEP_PX // 2) / GRID_STEP_PX).astype(np.intp).T
    inside = ahead & (columns >= 0) & (columns < grid.columns) & (rows >= 0) & (rows < grid.rows)
    return np.where(inside, rows * grid.columns + columns, 0), inside


def _gray(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    return rgb.astype(np.float64) @ np.array([0.299, 0.587, 0.114])


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    if len(a) < _MIN_SURFACE:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    # The constant draws the correlation of surfaces without texture towards zero.
    return float(a @ b / (scale + 25.0 * len(a)))


def _colour_difference(
    colours: NDArray[np.uint8], image: NDArray[np.uint8], places: NDArray[np.intp], grid: ImageGrid
) -> ColourDifference:
    """Return the difference of colours (N, 3) from those of an image (M, 3) at and beside places (N,)."""
    if len(colours) < _MIN_SURFACE:
        return ColourDifference(0.0, 0.0)
    shown = image.reshape(grid.rows, grid.columns, 3)
    around = np.ones((3, 3), np.uint8)
    darkest = cv2.erode(shown, around).reshape(-1, 3)[places].astype(np.float64)
    brightest = cv2.dilate(shown, around).reshape(-1, 3)[places].astype(np.float64)
    # Exposure and white balance may have changed between the images.
    gain = (np.median(image[places], axis=0) + 5) / (np.median(colours, axis=0) + 5)
    expected = np.minimum(colours * gain, 255)
    off = np.maximum(darkest - expected, expected - brightest).max(1).clip(0, _MAX_COLOUR_GAP)
    return ColourDifference(float((off > _COLOUR_TOLERANCE).mean()), float(off.mean()))


INLIER_REACH = 0.009
"""Largest distance of an agreeing key point from its predicted position, as rays at one metre of depth."""
_CELLS = 4
"""Number of cells along each side of the image, for measuring the spread of key points."""
_RIVALS = 160
"""Number of the strongest key points that are searched for rival matches."""
_RIVAL_MARGIN, _RIVAL_MIN = 0.05, 0.75
"""Limits of a rival match: its cosine is at most the margin below that of the best match, and at least the minimum."""
_RIVAL_REACH_M = 0.08
"""Largest difference of two translations that support each other, in metres."""
_RIVAL_PAIRS = 300
"""Largest number of rival matches; more add no information."""


class Evidence(NamedTuple):
    """Evidence for one pose; shares are in [0, 1]."""

    agreeing: float
    """Logarithm of one plus the number of key points that agree with the pose."""
    agreeing_share: float
    """Share of the matches by descriptors alone that agree with the pose."""
    repeated_share: float
    """Share of the key points expected in both images that were found in both."""
    spread: float
    """Share of the image's cells with agreeing key points; the lesser value of the two images."""
    overlap: float
    """Share of the surface points that lie in the other image; the lesser value of the two images."""
    depth_agreement: float
    """Share of the overlapping surface points whose depth agrees."""
    depth_conflict: float
    """Share of the overlapping surface points that lie in free space of the other image."""
    brightness: float
    """Correlation of the brightness of agreeing surface points."""
    colour_conflict: float
    """Share of the agreeing surface points whose colour does not occur nearby in the other image."""
    colour_gap: float
    """Mean colour difference of agreeing surface points, on a scale of 0 to 255, each at most 40."""
    rival: float
    """Ratio of the support of the best other translation, as in repeated patterns, to that of this one."""
    tilt_gap: float
    """Angle in radians between the gravity directions of both images, beyond the usual error."""
    uncertainty: float
    """Logarithm of the standard deviation of the translation in metres."""


NO_EVIDENCE = Evidence(*[0.0] * len(Evidence._fields))
"""Evidence of zeros, for a pair without a pose."""


def agreeing_pairs(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    """Return a mask (P,) of the pairs that agree with a motion, in rays and in depth."""
    return np.logical_or(_seen_there(motion, pairs), _seen_there(motion.inverse(), pairs.swapped()))


def _seen_there(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    there = motion.apply(points(pairs.first_rays, pairs.first_depth))
    ahead = np.maximum(there[:, 2], 0.05)
    gaps = np.linalg.norm(there[:, :2] / ahead[:, None] - pairs.second_rays, axis=1)
    off = np.abs(ahead - pairs.second_depth)
    fits = (pairs.second_depth == 0) | (off < DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * ahead)
    return (pairs.first_depth > 0) & (there[:, 2] > 0.05) & (gaps < INLIER_REACH) & fits


def spread(rays: NDArray[np.floating], camera: CameraModel) -> float:
    """Return the share of the image's cells in which any of the rays (P, 2) lies."""
    pixels = camera.rays_to_pixels(np.asarray(rays, np.float64))
    cells = np.floor((pixels + 0.5) / np.array([camera.width, camera.height]) * _CELLS)
    cells = np.clip(np.nan_to_num(cells), 0, _CELLS - 1)
    return len(np.unique(cells[:, 0] * _CELLS + cells[:, 1])) / _CELLS**2


def rival_support(
    motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, cosines: NDArray[np.float32]
) -> float:
    """Return the ratio of the key points' support for the best other translation to that for the motion's.

    The rotation is kept. On tiles, or between equal doors, key points have several matches almost as good as the best.
    """
    known = np.flatnonzero(first.depth > 0)[:_RIVALS]
    others = np.flatnonzero(second.depth > 0)
    if len(known) < 2 or len(others) < 5:
        return 0.0
    likely = cosines[known] if len(others) == cosines.shape[1] else cosines[np.ix_(known, others)]
    matched = likely.max(1) > _RIVAL_MIN  # The other key points have no match above the minimum.
    known, likely = known[matched], likely[matched]
    best = np.argpartition(-likely, 3, axis=1)[:, :4]
    value = np.take_along_axis(likely, best, axis=1)
    good = (value > value.max(1, keepdims=True) - _RIVAL_MARGIN) & (value > _RIVAL_MIN)
    rows, picks = np.nonzero(good)
    a = known[rows]
    b = others[best[rows, picks]]
    shifts = points(second.rays[b], second.depth[b]) - points(first.rays[a], first.depth[a]) @ motion.rotation.T
    shifts = shifts[:_RIVAL_PAIRS]
    squares = (shifts**2).sum(1)
    near = squares[:, None] + squares - 2 * shifts @ shifts.T < _RIVAL_REACH_M**2
    off = np.linalg.norm(shifts - motion.translation, axis=1)
    own = np.count_nonzero(off < _RIVAL_REACH_M)
    rivals = near.sum(1)[off > 3 * _RIVAL_REACH_M]
    return float(min(rivals.max(initial=0) / max(own, 1), 2.0))


CALIBRATION_FILE = Path(__file__).with_name("geometric_calibration.json")
"""File of the fitted weights, and of the data to which they were fitted."""


NO_DEPTH, ONE_DEPTH, BOTH_DEPTHS = "none", "one", "both"
"""Names for the number of depth images in a pair."""
DEPTHS = (NO_DEPTH, ONE_DEPTH, BOTH_DEPTHS)

MAX_DEPTH_M = 100.0
_MOST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Logistic:
    """A logistic regression, with its weights by the names of the evidence."""

    weights: Mapping[str, float]
    bias: float

    def probability(self, evidence: Mapping[str, float]) -> float:
        """Return the probability that a pose is right."""
        total = self.bias + sum(weight * evidence[name] for name, weight in self.weights.items())
        return float(1 / (1 + np.exp(-np.clip(total, -30, 30))))


@dataclass(frozen=True, slots=True)
class Calibration:
    """The weights of the evidence for pairs with and without depth."""

    logistics: Mapping[str, Logistic]
    """Logistic regressions by the number of depth images, see `DEPTHS`."""
    room_depth_m: float = ROOM_DEPTH_M
    """Usual depth of a room in metres, the scale of guessed distances if no image has depth."""
    card: Mapping[str, Any] = field(default_factory=dict)
    """Description of the data to which it was fitted, as JSON values."""

    @property
    def fingerprint(self) -> str:
        """Fingerprint of its numbers, 12 hexadecimal digits."""
        numbers = {name: [dict(part.weights), part.bias] for name, part in self.logistics.items()}
        text = json.dumps([numbers, self.room_depth_m], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def text(self) -> str:
        """Return the text that `read_calibration` reads."""
        logistics = {name: {"weights": dict(part.weights), "bias": part.bias} for name, part in self.logistics.items()}
        held = {"logistics": logistics, "room_depth_m": self.room_depth_m, "card": dict(self.card)}
        return json.dumps(held, indent=1) + "\n"


@lru_cache(maxsize=1)
def shipped_calibration() -> Calibration:
    """Return the calibration in the package."""
    return read_calibration(CALIBRATION_FILE)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration. Raises WeightsError for a file that is missing, truncated or no calibration."""
    try:
        held = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what="calibration"))
        logistics = {name: _logistic(held["logistics"][name]) for name in DEPTHS}
        depth = _finite(held.get("room_depth_m", ROOM_DEPTH_M))
        if not 0 < depth < MAX_DEPTH_M:
            raise ValueError(f"room_depth_m is {depth:g}")
        return Calibration(logistics, depth, dict(held.get("card", {})))
    except (DriveError, OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise WeightsError(
            f"{path}: no calibration of the geometric predictor ({reason}); `ltvn finetune DRIVE.rrd --predictor "
            "geometric --output NAME.json` writes one, and without --weights the one of the package is used."
        ) from error


def _logistic(part: Mapping[str, Any]) -> Logistic:
    weights = {str(name): _finite(weight) for name, weight in part["weights"].items()}
    if weights.keys() != set(Evidence._fields):
        raise ValueError(f"weights are of {', '.join(weights) or 'nothing'}, not of {', '.join(Evidence._fields)}")
    return Logistic(weights, _finite(part["bias"]))


def _finite(number: object) -> float:
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
        raise ValueError(f"{number!r:.40} is not a number")
    return float(number)
