"""`python -m figures.drive_pictures`: pictures of a drive and of its map, as `docs/how-to/your-bag.md` shows them."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

from ltvn_core.cli import run_verb
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.types import Observation
from ltvn_core.verbs.verb import Summary, Verb

COLUMNS = 4
SIZE = (240, 180)
"""Width and height of one picture in pixels."""
_GAP = 4
_NEAREST_M, _FARTHEST_M = 0.5, 4.0
"""Depth between these is drawn from yellow to blue; what has none is black."""


@dataclass(frozen=True)
class DrivePicturesSummary:
    """What was drawn."""

    pictures: tuple[Path, ...]


@dataclass(frozen=True, kw_only=True)
class DrivePicturesVerb(Verb):
    """Draw some images of a recording with their depth, and the images of a map's nodes."""

    recording: Positional[Path]
    """The recording."""
    map: Positional[Path]
    """The map that was built of it."""
    output: Path = Path("docs/images/your-bag")
    """Where the pictures go."""

    def run(self) -> Summary:
        """Draw; raises RecordingError and MapError."""
        recording, loaded = Recording.open(self.recording), load_map(self.map)
        chosen = np.linspace(0, len(recording.frames) - 1, COLUMNS).astype(int)
        images = [recording.observation(recording.frames[place]) for place in chosen]
        nodes = [loaded.observations[node] for node in loaded.graph.nodes]
        self.output.mkdir(parents=True, exist_ok=True)
        sheets = {
            "drive.jpg": sheet([*map(colours, images), *map(depth, images)]),
            "nodes.jpg": sheet([colours(seen) for seen in nodes]),
        }
        for name, sheet_rgb in sheets.items():
            cv2.imwrite(str(self.output / name), sheet_rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 80))
        return DrivePicturesSummary(tuple(self.output / name for name in sheets))


def colours(seen: Observation) -> NDArray[np.uint8]:
    """Return an image at the size of one picture."""
    return np.asarray(cv2.resize(seen.rgb, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def depth(seen: Observation) -> NDArray[np.uint8]:
    """Return depth in colours; black where there is none."""
    if seen.depth is None:
        return np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    metres = cv2.resize(seen.depth, SIZE, interpolation=cv2.INTER_NEAREST)
    share = np.clip((_FARTHEST_M - metres) / (_FARTHEST_M - _NEAREST_M), 0, 1)
    drawn = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1].copy()
    drawn[metres == 0] = 0
    return np.asarray(drawn, np.uint8)


def sheet(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return pictures in rows of four on white."""
    rows = -(-len(pictures) // COLUMNS)
    width, height = SIZE[0] + _GAP, SIZE[1] + _GAP
    drawn = np.full((rows * height - _GAP, COLUMNS * width - _GAP, 3), 255, np.uint8)
    for place, picture in enumerate(pictures):
        top, left = place // COLUMNS * height, place % COLUMNS * width
        drawn[top : top + SIZE[1], left : left + SIZE[0]] = picture
    return drawn


if __name__ == "__main__":
    sys.exit(run_verb("python -m figures.drive_pictures", DrivePicturesVerb))
