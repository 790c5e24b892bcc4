"""Floor plans in the format of nav2's map server: `map.yaml` and its image, read as an occupancy grid.

Owns the map server's conversion of brightness to occupancy, and the position of each pixel: the origin is the pose of
the image's lower left corner, in metres and radians. The image must be in the folder of `map.yaml` or below it, because
a file from an untrusted source must not read other files.
"""

import math
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core import palette
from ltvn_core.cameras.encoded_images import decode_colour, encoded_size
from ltvn_core.data.importing.foreign_files import read_bytes_within
from ltvn_core.data.importing.source_camera import CalibrationYaml
from ltvn_core.errors import DriveError
from ltvn_core.geometry import compose, relative
from ltvn_core.types import Pose

UNKNOWN = -1
OCCUPIED = 100
MOST_M = 100_000.0
"""Upper limit for the size of a floor plan and for its distance from the origin, in metres."""
_PICTURES = frozenset((".pgm", ".png", ".jpg", ".jpeg", ".bmp"))
_OCCUPIED_THRESHOLD, _FREE_THRESHOLD = 0.65, 0.196
"""Default thresholds. The grey value 205, which map savers write for unknown, is just above the second, so it is not
free."""
_WHITE = 3 * 255
_YES, _NO = ("1", "true", "yes", "on"), ("0", "false", "no", "off", "")


class FloorPlanMode(Enum):
    """How nav2's map server converts brightness to occupancy."""

    TRINARY = "trinary"
    """Cells are free, occupied or unknown."""
    SCALE = "scale"
    """Brightness between both thresholds is converted linearly to occupancy."""
    RAW = "raw"
    """The pixel is the value of the cell, 0 to 100."""


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """An occupancy grid of a floor, and its pose."""

    cells: NDArray[np.int8]
    """(H, W) occupancy: 0 is free, 100 occupied, -1 unknown; the first row is the top row of the image."""
    resolution_m: float
    """Side of a cell in metres."""
    corner: Pose
    """(3,) pose of the image's lower left corner; x runs along its lower side."""

    @classmethod
    def open(cls, path: Path) -> Self:
        """Read `map.yaml` and its image. Raises DriveError, whose message says what to correct."""
        if path.suffix.lower() in _PICTURES:
            raise DriveError(
                f"{path} is the picture of a floor plan; name its map.yaml instead, which says where it lies. If "
                f"there is none, write one: image: {path.name}, resolution: 0.05 (metres per pixel), origin: [0, 0, 0] "
                "(x, y, yaw of the lower left corner), each in its own line."
            )
        said = CalibrationYaml(path, what="map.yaml")
        name = said.word("image")
        if not name:
            raise DriveError(f"{path} names no image; a map.yaml of nav2 has a line such as `image: map.pgm`.")
        resolution_m = _number(said, "resolution", path)
        if not 0 < resolution_m < MOST_M:
            raise DriveError(
                f"{path}: resolution must be above 0 metres per pixel, such as 0.05; got {resolution_m:g}."
            )
        origin = said.numbers("origin")
        if len(origin) != 3 or max(map(abs, origin)) > MOST_M:
            raise DriveError(f"{path}: origin is [x, y, yaw] of the lower left corner, in metres and radians.")
        shown = _shown_cells(said, path)
        source = f"{name} of {path}"
        blob = read_bytes_within(path.parent, name)
        width, height = encoded_size(blob, source)
        if max(width, height) * resolution_m > MOST_M:
            raise DriveError(f"{source} would be {max(width, height) * resolution_m:,.0f} m long; check resolution.")
        cells = shown[decode_colour(blob, source).sum(axis=2, dtype=np.uint16)]
        return cls(cells, resolution_m, np.array(origin, np.float64))

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height in metres."""
        height, width = self.cells.shape
        return width * self.resolution_m, height * self.resolution_m

    @property
    def middle(self) -> Pose:
        """Pose (3,) of the image's centre."""
        width_m, height_m = self.size_m
        return compose(self.corner, np.array([width_m / 2, height_m / 2, 0.0]))

    def moved(self, frame: Pose) -> Self:
        """Return the plan in another frame; `frame` (3,) is the pose of the current frame in the other frame."""
        return replace(self, corner=compose(frame, self.corner))

    def cells_at(self, places: ArrayLike) -> NDArray[np.int8]:
        """Return the occupancy (N,) at positions (N, 2) in metres; -1 (unknown) outside the plan."""
        places = np.asarray(places, np.float64).reshape(-1, 2)
        inside = relative(self.corner, np.column_stack([places, np.zeros(len(places))]))
        column, up = np.floor(inside[:, :2].T / self.resolution_m)
        height, width = self.cells.shape
        row = height - 1 - up
        known = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        found = np.full(len(places), UNKNOWN, np.int8)
        found[known] = self.cells[row[known].astype(int), column[known].astype(int)]
        return found

    def picture(self, most_px: int) -> NDArray[np.uint8]:
        """Return an RGBA image (H, W, 4) whose longer side has at most `most_px` pixels; unknown is transparent."""
        share = np.linspace(0, 1, OCCUPIED + 1)[:, None]
        ramp = (1 - share) * np.array(palette.FLOOR_PLAN_FREE) + share * np.array(palette.FLOOR_PLAN_WALL)
        colours = np.full((OCCUPIED + 2, 4), 255, np.uint8)  # The last row is for -1 (unknown).
        colours[:-1, :3] = ramp.round()
        colours[-1] = (*palette.FLOOR_PLAN_FREE, 0)
        drawn = colours[self.cells]
        height, width = self.cells.shape
        shrink = most_px / max(height, width)
        if shrink >= 1:
            return drawn
        size = max(round(width * shrink), 1), max(round(height * shrink), 1)
        return np.asarray(cv2.resize(drawn, size, interpolation=cv2.INTER_AREA), np.uint8)


def _number(said: CalibrationYaml, name: str, path: Path, default: float | None = None) -> float:
    word = said.word(name)
    if not word and default is not None:
        return default
    try:
        number = float(word)
    except ValueError as error:
        raise DriveError(f"{path}: {name} must be a number, got {word!r:.40}.") from error
    if not math.isfinite(number):
        raise DriveError(f"{path}: {name} must be a finite number, got {word!r:.40}.")
    return number


def _shown_cells(said: CalibrationYaml, path: Path) -> NDArray[np.int8]:
    """Return the occupancy (766,) for each sum of red, green and blue. Raises DriveError."""
    negate = said.word("negate").lower()
    if negate not in (*_YES, *_NO):
        raise DriveError(f"{path}: negate is 0 or 1, got {negate!r:.40}.")
    try:
        mode = FloorPlanMode(said.word("mode") or FloorPlanMode.TRINARY.value)
    except ValueError as error:
        known = ", ".join(each.value for each in FloorPlanMode)
        raise DriveError(f"{path}: mode is one of {known}, got {said.word('mode')!r:.40}.") from error
    occupied = _number(said, "occupied_thresh", path, _OCCUPIED_THRESHOLD)
    free = _number(said, "free_thresh", path, _FREE_THRESHOLD)
    if not 0 <= free < occupied <= 1:
        raise DriveError(
            f"{path}: free_thresh ({free:g}) must be below occupied_thresh ({occupied:g}), both from 0 to 1."
        )
    shade = np.arange(_WHITE + 1) / _WHITE
    taken = shade if negate in _YES else 1 - shade
    match mode:
        case FloorPlanMode.RAW:
            value = np.rint(255 * shade)
            return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
        case FloorPlanMode.SCALE:
            between = np.rint(OCCUPIED * (taken - free) / (occupied - free))
        case FloorPlanMode.TRINARY:
            between = np.full(len(taken), UNKNOWN)
    return np.select([taken > occupied, taken < free], [OCCUPIED, 0], between).astype(np.int8)
