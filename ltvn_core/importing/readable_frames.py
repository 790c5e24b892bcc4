"""The frames of a source whose images lie in files: each that can be read, and what is said of the others."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from ltvn_core.errors import DriveError
from ltvn_core.importing.raw_frame import FrameFilter, FrameMoment, RawFrame

DAMAGED = "damaged or missing image"

_Image = TypeVar("_Image")


def readable_frames(
    images: Iterable[tuple[FrameMoment, _Image]],
    read: Callable[[FrameMoment, _Image], RawFrame],
    wanted: FrameFilter,
    *,
    dropped: Counter[str],
    doubts: list[str],
) -> Iterator[RawFrame]:
    """Yield the wanted frames; one that cannot be read is counted, and the first of them is a doubt.

    Args:
        images: The moments of a drive, each with what `read` needs to know of its image.
        read: Reads one image. Raises DriveError where that is impossible.
        wanted: Tells from the moment whether a frame is wanted; the image of another is not read.
        dropped: Gets the number of images that cannot be read, as `DAMAGED`.
        doubts: Gets a sentence about the first of them.
    """
    for moment, image in images:
        if not wanted(moment):
            continue
        try:
            yield read(moment, image)
        except DriveError as error:
            if not dropped[DAMAGED]:
                doubts.append(f"An image was left out: {error}")
            dropped[DAMAGED] += 1
