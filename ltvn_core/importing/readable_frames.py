"""The frames of a source whose images lie in files: each that can be read, and what is said of the others."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from ltvn_core.errors import DriveError
from ltvn_core.importing.raw_frame import FrameFilter, FrameMoment, RawFrame

DAMAGED = "damaged or missing image"
_MOST_AT_FIRST = 1000
"""Where so many are damaged before one is not, the images are elsewhere, and looking for a million takes minutes."""

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

    Raises:
        DriveError: A drive begins with nothing but images that cannot be read.
    """
    found_any = False
    for moment, image in images:
        if not wanted(moment):
            continue
        try:
            yield read(moment, image)
            found_any = True
        except DriveError as error:
            if not dropped[DAMAGED]:
                doubts.append(f"An image was left out: {error}")
            dropped[DAMAGED] += 1
            if not found_any and dropped[DAMAGED] >= _MOST_AT_FIRST:
                raise DriveError(f"None of the first {_MOST_AT_FIRST:,} images can be read. {doubts[-1]}") from error
