"""Finds the pictures of a folder, and tells colours from depth: many programs save both in one folder.

Owns the names that folders have, the order of the pictures, and which depth image belongs to which picture.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from ltvn_core.errors import DriveError

IMAGE_SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".webp", ".bmp", ".ppm", ".tif", ".tiff", ".heic", ".heif"))
UNREADABLE_SUFFIXES = frozenset(
    (".avif", ".jxl", ".jp2", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".exr", ".tga")
)
"""Pictures too, which nothing here reads."""
IMAGE_FOLDERS = ("", "rgb", "images", "color", "colour", "image", "img", "mono", "left", "results", "frames", "seq")
"""Where pictures lie: in the folder itself, or in one of these."""
DEPTH_FOLDER = "depth"
FEWEST = 2

_DEPTH_NAME = re.compile(r"(?:^|[^a-z])depth(?![a-z])", re.IGNORECASE)
_DEEP_SUFFIXES = (".png", ".tif", ".tiff")
_DEEP_MODES = ("I", "F", "I;16", "I;16B", "I;16L")
"""Pillow's names of one channel with more than 8 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderPictures:
    """The pictures of one folder, in natural order."""

    colours: Sequence[Path]
    deep: Sequence[Path]
    """One channel of more than 8 bits: depth, never colours."""
    shallow: Sequence[Path]
    """Named depth, but with 8 bits: pictures of depth for the eye, and neither."""
    unreadable: Sequence[Path]

    def doubts(self) -> Iterable[str]:
        """Yield which pictures are left out, in whole sentences."""
        if self.unreadable:
            kinds = kinds_of(self.unreadable)
            yield f"{len(self.unreadable)} pictures are of a kind that is not read ({kinds}). {_conversion(kinds)}"
        if self.shallow:
            yield (
                f"{len(self.shallow)} pictures such as {self.shallow[0].name} are named depth but have 8 bits, which "
                "is too few for depth, so they were left out. Save depth as PNG of 16 bits in millimetres."
            )


def colour_pictures(folder: Path, wanted: str | None) -> FolderPictures:
    """Return the pictures of a folder or of the folder in it that holds them. Raises DriveError without colours."""
    if not folder.is_dir():
        raise DriveError(f"{folder} is no folder; name the folder that the pictures lie in.")
    found: list[FolderPictures] = []
    for name in IMAGE_FOLDERS if wanted is None else (wanted,):
        found.append(_sorted_out(folder / name))
        if found[-1].colours:
            return found[-1]
    for each in found:
        if each.unreadable:
            kinds = kinds_of(each.unreadable)
            raise DriveError(
                f"{each.unreadable[0].parent} holds pictures that are not read: {kinds}. {_conversion(kinds)}"
            )
        if each.deep or each.shallow:
            some = [*each.deep, *each.shallow]
            raise DriveError(
                f"{some[0].parent} holds {len(some)} pictures of depth ({some[0].name} and others) and none of "
                "colours; name the folder of the colours by --rgb."
            )
    raise DriveError(f"{folder / (wanted or '')} holds no pictures ({', '.join(sorted(IMAGE_SUFFIXES))}).")


def holds_pictures(path: Path) -> bool:
    """Tell whether a folder holds some pictures, readable or not, by their names."""
    return any(_count(path / name) >= FEWEST for name in IMAGE_FOLDERS)


def depth_partners(folder: Path, wanted: str | None, pictures: FolderPictures) -> Mapping[Path, Path]:
    """Return the depth images by the pictures they belong to: of the same name, or else of the same numbers.

    Raises DriveError where a folder that a person named holds none.
    """
    listed = _listed(folder / (wanted or DEPTH_FOLDER), IMAGE_SUFFIXES)
    if wanted is not None and folder / wanted == pictures.colours[0].parent:
        listed = list(pictures.deep)
    if wanted is not None and not listed:
        raise DriveError(f"{folder / wanted} holds no depth images; give the name of their folder, or none.")
    found = listed or pictures.deep
    by_stem = {path.stem: path for path in found}
    by_numbers = _unique({path: _numbers(path) for path in found})
    asking = _unique({path: _numbers(path) for path in pictures.colours})
    numbered = {path: by_numbers[key] for key, path in asking.items() if key in by_numbers}
    named = {path: by_stem[path.stem] for path in pictures.colours if path.stem in by_stem}
    return numbered | named


def kinds_of(paths: Iterable[Path]) -> str:
    """Return the endings of files and how many there are of each."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(p.suffix.lower() for p in paths).items()))


def _conversion(kinds: str) -> str:
    suffix = kinds.split()[-1]
    return f"`magick mogrify -format jpg *{suffix}` writes them as JPEG."


def _sorted_out(folder: Path) -> FolderPictures:
    listed = _listed(folder, IMAGE_SUFFIXES)
    deep = {path for path in listed if _is_deep(path)}
    shallow = {path for path in listed if path not in deep and _DEPTH_NAME.search(path.stem)}
    if len(deep) + len(shallow) == len(listed) and shallow:
        shallow = set()  # There is nothing else: names alone do not make all of them depth.
    return FolderPictures(
        colours=[path for path in listed if path not in deep and path not in shallow],
        deep=[path for path in listed if path in deep],
        shallow=[path for path in listed if path in shallow],
        unreadable=_listed(folder, UNREADABLE_SUFFIXES),
    )


def _listed(folder: Path, suffixes: Iterable[str]) -> list[Path]:
    """Return the files of a folder that end so, in natural order: 2 before 10."""
    if not folder.is_dir():
        return []
    found = (path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith("."))
    return sorted(found, key=lambda path: [int(p) if p.isdigit() else p for p in re.split(r"([0-9]+)", path.name)])


def _count(folder: Path) -> int:
    return len(_listed(folder, IMAGE_SUFFIXES | UNREADABLE_SUFFIXES))


def _is_deep(path: Path) -> bool:
    """Tell by the header whether a picture has one channel of more than 8 bits; pipes and damaged ones have not."""
    if path.suffix.lower() not in _DEEP_SUFFIXES or not path.is_file():
        return False
    try:
        with path.open("rb") as file, Image.open(file, formats=("PNG", "TIFF")) as header:
            return header.mode in _DEEP_MODES
    except Exception:  # Pillow's readers raise many kinds; of what is damaged is said where it is decoded.
        return False


def _numbers(path: Path) -> tuple[int, ...]:
    return tuple(int(digits) for digits in re.findall(r"[0-9]+", path.stem))


def _unique(numbers: Mapping[Path, tuple[int, ...]]) -> dict[tuple[int, ...], Path]:
    """Return the files by their numbers, without those whose numbers others have too."""
    counts = Counter(numbers.values())
    return {key: path for path, key in numbers.items() if key and counts[key] == 1}
