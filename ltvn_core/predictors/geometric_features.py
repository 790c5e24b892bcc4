"""Image features of the geometric predictor, and the shortlist of the most similar images.

An image has key points with descriptors and depth, a coarse depth image, and a place vector that summarises its
descriptors: a VLAD (H. Jegou et al., CVPR 2010) of RootSIFT descriptors. Owns the detection of key points (RootSIFT,
OpenCV) and the shortlist of one image against many: first by place vectors, then by votes of the strongest key points.
Decides nothing about reachability.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import ImageError
from ltvn_core.types import Depth, Observation, Rgb

WORDS_FILE = Path(__file__).with_name("geometric_words.npz")
"""File of the visual words, which `tools/fit_geometric.py` fitted."""

VOTERS = 96
"""Number of an image's strongest key points that vote."""

_VOTE_RATIO = 0.85


class VisualWords(NamedTuple):
    """Visual vocabulary: W cluster centres of descriptors, reduced to D dimensions by PCA."""

    mean: NDArray[np.float32]
    """(128,) mean descriptor."""
    axes: NDArray[np.float32]
    """(128, D) axes of the PCA."""
    centres: NDArray[np.float32]
    """(W, D) cluster centres."""


@lru_cache(maxsize=1)
def visual_words() -> VisualWords:
    """Return the visual words in the package."""
    with np.load(WORDS_FILE) as stored:
        return VisualWords(*(stored[name].astype(np.float32) for name in VisualWords._fields))


def place_vector(descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the VLAD of an image's descriptors (K, 128), a unit vector (W * D,); zeros if K is 0."""
    words = visual_words()
    if not len(descriptors):
        return np.zeros(words.centres.size, np.float32)
    reduced = (descriptors.astype(np.float32) - words.mean) @ words.axes
    nearest = (reduced @ words.centres.T - (words.centres**2).sum(1) / 2).argmax(1)
    sums = np.zeros_like(words.centres)
    np.add.at(sums, nearest, reduced - words.centres[nearest])
    # Normalised per word, so that a frequent word, as on a tiled floor, counts no more than any other.
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-6)
    vector = sums.ravel()
    return (vector / np.maximum(np.linalg.norm(vector), 1e-6)).astype(np.float32)


def most_similar(vector: NDArray[np.float32], others: Sequence[NDArray[np.float32]], count: int) -> NDArray[np.intp]:
    """Return the rows of the `count` vectors most similar to one, the best first."""
    likeness = np.stack(others) @ vector
    return np.argsort(-likeness, kind="stable")[:count]


def votes(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> int:
    """Return the number of one image's strongest descriptors (K, 128) with a clear match in another image."""
    cosines = (first[:VOTERS].astype(np.float32) / 255**2) @ second[: 2 * VOTERS].astype(np.float32).T
    if cosines.shape[0] == 0 or cosines.shape[1] < 2:
        return 0
    top = np.partition(cosines, -2, axis=1)[:, -2:]
    return int(np.count_nonzero((1 - top[:, 1]) < _VOTE_RATIO**2 * (1 - top[:, 0])))


KEY_POINTS = 640
"""Largest number of key points per image; the strongest ones are kept."""

GRID_STEP_PX = 4
"""Step in pixels between the points of the coarse depth image, along rows and columns."""

CONTRAST_THRESHOLD = 0.01
"""Contrast threshold of SIFT, lower than the usual 0.04, because walls and doors have little contrast."""
EDGE_THRESHOLD = 12.0

FEW_KEY_POINTS = 100
"""Number of key points below which an image, as of bare walls, is searched again for faint ones."""
FAINT_CONTRAST_THRESHOLD = 0.003
FAINT_KEY_POINTS = 320
"""Largest number of key points of such an image; twice as many find no more near pairs."""

MAX_DEPTH_M = 12.0
"""Largest depth that is used, in metres; larger ones are too uncertain."""

OPTICAL_TO_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from OpenCV's axes (right, down, ahead) to forward, left, up."""

WIDEST_RAY = 2.5
"""Largest distance of a key point from the optical axis at one metre of depth (68 degrees). Farther out, a pixel covers
too large a part of that plane."""

_DESCRIPTOR_SCALE = 255.0


@dataclass(frozen=True, slots=True, eq=False)
class ImageFeatures:
    """One image with K key points, strongest first, and M points of a coarse grid."""

    key: bytes
    """Hash of the image, of its depth and of its tilt; equal images have equal keys."""
    rays: NDArray[np.float32]
    """(K, 2) rays of the key points: right and down of the optical axis, at one metre of depth."""
    depth: NDArray[np.float32]
    """(K,) depth of the key points in metres; 0 where missing."""
    descriptors: NDArray[np.uint8]
    """(K, 128) RootSIFT descriptors, of length 255."""
    grid_depth: NDArray[np.float32]
    """(M,) depth of the coarse grid in metres; 0 where missing."""
    grid_rgb: NDArray[np.uint8]
    """(M, 3) mean colour around each grid point."""
    level: NDArray[np.float64]
    """(3, 3) rotation from the camera's axes (right, down, ahead) to forward, left, up of a level robot."""
    has_own_tilt: bool
    """Whether the camera's tilt was measured for this image, as for a hand-held camera."""
    place: NDArray[np.float32]
    """(D,) place vector of the image, see `place_vector`."""
    clear: int
    """Number of key points found with the usual contrast threshold; the other ones are faint."""

    @property
    def has_depth(self) -> bool:
        """Whether enough of the image has depth for measurements."""
        return bool(np.count_nonzero(self.grid_depth) * 50 >= self.grid_depth.size)


class ImageGrid(NamedTuple):
    """The M pixels of a camera's coarse depth image, row by row."""

    rows: int
    columns: int
    pixels: NDArray[np.intp]
    """(M, 2) column and row in the image."""
    rays: NDArray[np.float32]
    """(M, 2) rays, right and down at one metre of depth; NaN where a fisheye looks sideways."""
    pixel_ray: float
    """Median size of a pixel as a ray: without distortion, one over the focal length."""


def image_grid(camera: CameraModel) -> ImageGrid:
    """Return the coarse grid of a camera."""
    half = GRID_STEP_PX // 2
    rows = np.arange(half, camera.height, GRID_STEP_PX)
    columns = np.arange(half, camera.width, GRID_STEP_PX)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = camera.pixels_to_rays(pixels.astype(np.float64)).astype(np.float32)
    steps = np.linalg.norm(np.diff(rays.reshape(len(rows), len(columns), 2), axis=1), axis=2) / GRID_STEP_PX
    pixel_ray = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    return ImageGrid(len(rows), len(columns), pixels, rays, pixel_ray)


class FeatureExtractor:
    """Extracts the features of images of one camera."""

    def __init__(self, camera: CameraModel) -> None:
        """Prepare for images of `camera`."""
        self._camera = camera
        self.grid = image_grid(camera)

    def extract(self, observation: Observation) -> ImageFeatures:
        """Return the features of an image. Raises ImageError if it does not have the camera's size."""
        rgb, depth = self._checked(observation)
        tilt = observation.tilt
        camera = self._camera
        if tilt is not None:
            camera = replace(camera, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad)
        gray = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2GRAY)
        pixels, descriptors, clear = _key_points(np.asarray(gray, np.uint8))
        rays = camera.pixels_to_rays(pixels.astype(np.float64))
        usable = np.hypot(rays[:, 0], rays[:, 1]) < WIDEST_RAY  # Also excludes NaN, where a fisheye looks sideways.
        pixels, descriptors, rays = pixels[usable], descriptors[usable], rays[usable]
        columns, rows = self.grid.pixels.T
        smooth = cv2.blur(np.ascontiguousarray(rgb), (GRID_STEP_PX, GRID_STEP_PX))
        return ImageFeatures(
            key=_hash(rgb, depth, camera),
            rays=rays.astype(np.float32),
            depth=_depth_at(depth, pixels),
            descriptors=descriptors,
            grid_depth=depth[rows, columns],
            grid_rgb=np.asarray(smooth, np.uint8)[rows, columns],
            level=camera.rotation @ OPTICAL_TO_CAMERA,
            has_own_tilt=tilt is not None,
            place=place_vector(descriptors),
            clear=clear,
        )

    def _checked(self, observation: Observation) -> tuple[Rgb, Depth]:
        shape = (self._camera.height, self._camera.width)
        depth = observation.depth
        if observation.rgb.shape != (*shape, 3) or (depth is not None and depth.shape != shape):
            raise ImageError(
                f"Image {observation.step} is {observation.rgb.shape[:2]}; this geometric predictor takes {shape} "
                "(rows, columns). Preprocess it with ltvn_core.preprocessing.preprocess_observation, which rectifies "
                "images of any camera, or create the predictor for the camera of the image."
            )
        if depth is None:
            return observation.rgb, np.zeros(shape, np.float32)
        return observation.rgb, np.where((depth > 0) & (depth < MAX_DEPTH_M), depth, 0).astype(np.float32)


def _key_points(gray: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.uint8], int]:
    """Return pixels (K, 2) and RootSIFT descriptors (K, 128) of the strongest key points, and the number of clear
    ones; faint ones are searched only where few are clear."""
    found, descriptors = _detected(gray, KEY_POINTS, CONTRAST_THRESHOLD)
    clear = len(found)
    if clear < FEW_KEY_POINTS:
        found, descriptors = _detected(gray, FAINT_KEY_POINTS, FAINT_CONTRAST_THRESHOLD)
    if not found:
        return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8), clear
    order = np.argsort([-point.response for point in found], kind="stable")[:KEY_POINTS]
    pixels = np.array([found[k].pt for k in order], np.float32)
    sift = descriptors[order]
    root = np.sqrt(sift / np.maximum(sift.sum(1, keepdims=True), 1e-6))
    return pixels, np.rint(root * _DESCRIPTOR_SCALE).astype(np.uint8), clear


def _detected(
    gray: NDArray[np.uint8], most: int, contrast: float
) -> tuple[Sequence[cv2.KeyPoint], NDArray[np.float32]]:
    # A new detector for each image, because detectors are not thread-safe.
    detector = cv2.SIFT.create(nfeatures=most, contrastThreshold=contrast, edgeThreshold=EDGE_THRESHOLD)
    found, descriptors = detector.detectAndCompute(gray, None)
    return found, np.asarray(descriptors, np.float32)


def _depth_at(depth: Depth, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the depth (K,) at pixels (K, 2): the median of the valid depths in 3 x 3 pixels."""
    if not depth.any() or not len(pixels):
        return np.zeros(len(pixels), np.float32)
    reach = np.arange(-1, 2)
    columns = np.clip(np.rint(pixels[:, 0]).astype(np.intp)[:, None] + np.tile(reach, 3), 0, depth.shape[1] - 1)
    rows = np.clip(np.rint(pixels[:, 1]).astype(np.intp)[:, None] + np.repeat(reach, 3), 0, depth.shape[0] - 1)
    around = np.sort(depth[rows, columns], axis=1)
    empty = (around == 0).sum(1)
    middle = np.minimum((empty + around.shape[1]) // 2, around.shape[1] - 1)
    return around[np.arange(len(around)), middle]


def _hash(rgb: Rgb, depth: Depth, camera: CameraModel) -> bytes:
    digest = hashlib.blake2b(np.ascontiguousarray(rgb).tobytes(), digest_size=16)
    digest.update(depth.tobytes())
    digest.update(repr(camera).encode())
    return digest.digest()
