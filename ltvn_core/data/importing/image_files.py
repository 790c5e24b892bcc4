"""Base class of readers whose images are files in a folder, including the treatment of damaged images.

Owns the conversion of a list of images to raw frames, and the least confidence of a phone's depth.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.encoded_images import decode_colour, decode_depth
from ltvn_core.data.importing.foreign_files import read_bytes_within
from ltvn_core.data.importing.raw_frame import DriveFacts, FrameFilter, FrameMoment, RawFrame, ReadOptions
from ltvn_core.data.importing.source_camera import fitted
from ltvn_core.errors import DriveError
from ltvn_core.types import Depth, Rgb

_LOWEST_OF_THREE = 0
_LARGEST_OF_THREE = 2
_LOW_PERCENT = 34
"""Confidence from 0 to 100 below which depth is discarded; if the levels are 0, 1 and 2, level 0 is discarded."""


class ReadableDepths:
    """Reads depth images, and counts those that cannot be read, because their colour images are useful without."""

    def __init__(self) -> None:
        """Start before the first depth image."""
        self._faults: list[str] = []

    def __call__(self, read: Callable[[], Depth | None]) -> Depth | None:
        """Return the depth that `read` returns; None if it cannot be read."""
        try:
            return read()
        except DriveError as error:
            self._faults.append(str(error))
            return None

    @property
    def doubts(self) -> list[str]:
        """Return the doubt about the depth images that could not be read, if there are any."""
        if not self._faults:
            return []
        return [f"{len(self._faults)} depth images could not be read, so their images have no depth: {self._faults[0]}"]


class ImageFilesReader(ABC):
    """A drive that is open for reading and whose images lie in files; a `DriveReader`."""

    facts: DriveFacts
    """The facts of the drive."""
    DAMAGED = "damaged or missing image"
    """Reason for leaving out an image that cannot be read."""
    MOST_AT_FIRST: float = 1000
    """Number of damaged images at the start after which reading stops, because trying a million files takes minutes."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Take the folder of all images, and the user's options for the drive."""
        self._folder = folder
        self._options = options
        self.dropped: Counter[str] = Counter()
        """Number of images that were left out, by reason."""
        self.doubts: list[str] = []
        """Doubts about the drive, as sentences."""
        self._if_readable = ReadableDepths()

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> Self:
        """Open a drive and read its lists, but no image yet. Raises DriveError."""
        return cls(path, options)

    def frames(self) -> Iterator[RawFrame]:
        """Yield all frames in order."""
        return self.frames_where(lambda _: True)

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames of the wanted moments; the images of other moments are not read.

        An image that cannot be read is counted, and the first such image is reported as a doubt. An image whose depth
        cannot be read comes without depth, which is a doubt too. Raises DriveError where the first `MOST_AT_FIRST`
        images cannot be read.
        """
        found_any = False
        for moment, image in self._images():
            if not wanted(moment):
                continue
            try:
                yield self._frame(moment, image)
                found_any = True
            except DriveError as error:
                if not self.dropped[self.DAMAGED]:
                    self.doubts.append(f"An image was left out: {error}")
                self.dropped[self.DAMAGED] += 1
                if not found_any and self.dropped[self.DAMAGED] >= self.MOST_AT_FIRST:
                    raise DriveError(
                        f"None of the first {self.MOST_AT_FIRST:,} images can be read. {self.doubts[-1]}"
                    ) from error
        self.doubts += self._if_readable.doubts

    @abstractmethod
    def _images(self) -> Iterable[tuple[FrameMoment, Any]]:
        """Return the moments of the drive, each with the data that `_frame` needs for its image."""

    @abstractmethod
    def _frame(self, moment: FrameMoment, image: Any) -> RawFrame:
        """Read one image. Raises DriveError if it cannot be read."""

    def _colours(self, name: str) -> Rgb:
        """Return the colours (H, W, 3) of a file in the folder. Raises DriveError."""
        return decode_colour(self._bytes(name), name)

    def _depth_m(self, name: str, unit_m: float) -> Depth:
        """Return the depth (H, W) in metres of a file in the folder; `unit_m` is the size of its unit. Raises
        DriveError."""
        return decode_depth(self._bytes(name), unit_m, name)

    def _bytes(self, name: str) -> bytes:
        """Return the bytes of a file of the drive. Raises DriveError."""
        return read_bytes_within(self._folder, name)

    def _without_unsure(self, depth_m: Depth, confidence: str) -> Depth:
        """Return depth (H, W) without the pixels of low confidence, by the image of that name. Raises DriveError."""
        levels = self._colours(confidence)[..., 0]
        if levels.shape != depth_m.shape:
            raise DriveError(
                f"{confidence} has {levels.shape[1]} x {levels.shape[0]} pixels and its depth image "
                f"{depth_m.shape[1]} x {depth_m.shape[0]}; save both in one size, or move the confidence images away."
            )
        return without_low_confidence(depth_m, levels)

    def _raw_frame(
        self,
        moment: FrameMoment,
        name: str,
        rgb: Rgb,
        *,
        camera: CameraModel | None,
        depth_m: Depth | None = None,
        depth_camera: CameraModel | None = None,
    ) -> RawFrame:
        """Return the frame of a moment, with the camera fitted to its image. Raises DriveError if the camera does not
        fit."""
        height, width = rgb.shape[:2]
        return RawFrame(
            stamp=moment.stamp,
            rgb=rgb,
            depth_m=depth_m,
            camera=None if camera is None else fitted(camera, width, height, name),
            depth_camera=depth_camera,
            odometry=moment.odometry,
            truth=moment.truth,
            tilt=moment.tilt,
            name=name,
        )


def without_low_confidence(depth_m: Depth, levels: NDArray[np.uint8]) -> Depth:
    """Return depth (H, W) with 0 (no return) where its confidence levels (H, W) are low."""
    is_of_three = levels.max(initial=0) <= _LARGEST_OF_THREE
    is_low = levels <= _LOWEST_OF_THREE if is_of_three else levels < _LOW_PERCENT
    return np.where(is_low, 0, depth_m).astype(np.float32)
