"""Reads a plain folder of pictures, with or without depth, with or without a table of odometry.

Pictures are read in natural order (2 before 10). Depth images are 16-bit PNGs in millimetres with the names or numbers
of the pictures. They are in `depth/` or in the folder of the pictures, where many programs save both; the pixel format
then tells colours from depth. `odometry.csv` has the columns `file` or `stamp`, `x`, `y`, `yaw`. True poses are read in
the formats of 7-Scenes, ScanNet and Replica (`importing.pose_track`). The lens comes from `camera.json`, or
approximately from the EXIF data of a picture.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.cameras.encoded_images import MAX_PIXELS
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import lens_beside
from ltvn_core.data.importing.pose_track import poses_beside
from ltvn_core.data.importing.raw_frame import NOTHING, FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import camera_beside
from ltvn_core.data.importing.stamped_lists import RATE_HZ, OdometryTable, natural_order, nearest, rate_hz
from ltvn_core.data.importing.unread_files import require_file, unread_beside
from ltvn_core.errors import DriveError

IMAGE_SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".webp", ".bmp", ".ppm", ".tif", ".tiff", ".heic", ".heif"))
UNREADABLE_SUFFIXES = frozenset(
    (".avif", ".jxl", ".jp2", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2", ".exr", ".tga")
)
"""Endings of image formats that are not supported; such files are only counted."""
IMAGE_FOLDERS = ("", "rgb", "images", "color", "colour", "image", "img", "mono", "left", "results", "frames", "seq")
"""Folders that may hold the pictures, in order of preference; the empty name is the folder itself."""
DEPTH_FOLDER = "depth"
FEWEST = 2
_LONE_SHARE = 0.05
_DEPTH_SLACK_S = 0.02
"""Least tolerance in seconds for matching colours and depth by stamps; it is half a frame if that is longer."""
_DEPTH_NAME = re.compile(r"(?:^|[^a-z])depth(?![a-z])", re.IGNORECASE)
_DEEP_SUFFIXES = (".png", ".tif", ".tiff")
_DEEP_MODES = ("I", "F", "I;16", "I;16B", "I;16L")
"""Pillow's modes for images with one channel of more than 8 bits."""
ODOMETRY_FILES = ("odometry.csv", "poses.csv")
CONFIDENCE_FOLDER = "confidence"
"""Folder beside the depth of phones, with confidence images of the same names; see `importing.file_drive`."""
_UNREADABLE = "image in an unsupported format"


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderPictures:
    """The pictures of one folder, in natural order."""

    colours: Sequence[Path]
    deep: Sequence[Path]
    """Pictures with one channel of more than 8 bits; they are depth, never colours."""
    shallow: Sequence[Path]
    """Pictures that are called depth but have only 8 bits; they are used neither as depth nor as colours."""
    unreadable: Sequence[Path]

    def doubts(self, depth: Collection[Path]) -> Iterable[str]:
        """Yield notes about the pictures that are left out, in whole sentences; `depth` are those used as depth."""
        if lone := [path for path in self.deep if path not in depth]:
            yield (
                f"{len(lone)} images such as {lone[0].name} have one channel of more than 8 bits, so they count as "
                "depth, and no colour image has their name or number, so they were left out. If they are pictures in "
                "grey, save them with 8 bits."
            )
        if self.unreadable:
            kinds = kinds_of(self.unreadable)
            yield f"{len(self.unreadable)} images are in unsupported formats ({kinds}). {_conversion(kinds)}"
        if self.shallow:
            yield (
                f"{len(self.shallow)} images such as {self.shallow[0].name} are called depth but have only 8 bits, so "
                "they were left out. Save depth as 16-bit PNG in millimetres."
            )


def colour_pictures(folder: Path, wanted: str | None) -> FolderPictures:
    """Return the pictures of a folder, or of the subfolder that holds them. Raises DriveError without colours."""
    if not folder.is_dir():
        raise DriveError(f"{folder} is not a folder; name the folder of the images.")
    found: list[FolderPictures] = []
    for name in IMAGE_FOLDERS if wanted is None else (wanted,):
        found.append(_sorted_out(folder / name))
        if found[-1].colours:
            return found[-1]
    for each in found:
        if each.unreadable:
            kinds = kinds_of(each.unreadable)
            raise DriveError(
                f"{each.unreadable[0].parent} contains images in unsupported formats: {kinds}. {_conversion(kinds)}"
            )
        if each.deep or each.shallow:
            some = [*each.deep, *each.shallow]
            raise DriveError(
                f"{some[0].parent} holds {len(some)} depth images ({some[0].name} and others) and no colour images; "
                "name the folder of the colour images with --rgb."
            )
    raise DriveError(f"{folder / (wanted or '')} contains no images ({', '.join(sorted(IMAGE_SUFFIXES))}).")


def most_pictures(path: Path) -> int:
    """Return by the file names how many pictures, supported or not, a folder or one of its image folders holds."""
    return max(_count(path / name) for name in IMAGE_FOLDERS)


def shows_colours(folder: Path) -> bool:
    """Tell whether the first picture of a folder, or of one of its image folders, has colours: depth, confidence and
    masks have one channel."""
    first = next((each for name in IMAGE_FOLDERS for each in _listed(folder / name, IMAGE_SUFFIXES)), None)
    if first is None or not first.is_file():
        return False
    try:
        with first.open("rb") as file, Image.open(file) as header:
            return header.mode in ("RGB", "RGBA", "P", "CMYK", "YCbCr")
    except Exception:  # As in `_is_deep`.
        return False


class DepthPairs(NamedTuple):
    """The depth images of a folder, and which picture each belongs to."""

    files: Sequence[Path]
    partners: Mapping[Path, Path]
    """Picture -> its depth image."""

    def doubts(self, pictures: Sequence[Path]) -> Iterator[str]:
        """Yield a sentence if many pictures and depth images have no partner: they may be counted separately."""
        used = set(self.partners.values())
        lone = [path for path in self.files if path not in used]
        bare = [path for path in pictures if path not in self.partners]
        if lone and bare and min(len(lone), len(bare)) > _LONE_SHARE * len(pictures):
            yield (
                f"{len(lone)} depth images such as {lone[0].name} and {len(bare)} images such as {bare[0].name} do not "
                "belong together by name, number or time. If their counters began at different numbers, the depth of "
                "the others is of another moment: give images and depth of one moment the same name."
            )


def depth_pairs(folder: Path, wanted: str | None, pictures: FolderPictures) -> DepthPairs:
    """Return the depth image of each picture that has one: by stamps where all names are stamps, otherwise with the
    same name, or the same numbers.

    Raises DriveError where the folder that the user named holds none.
    """
    listed = _listed(folder / (wanted or DEPTH_FOLDER), IMAGE_SUFFIXES)
    if wanted is not None and folder / wanted == pictures.colours[0].parent:
        listed = list(pictures.deep)
    if wanted is not None and not listed:
        raise DriveError(f"{folder / wanted} holds no depth images; give the name of their folder, or none.")
    found = listed or pictures.deep
    times = _stamps_of(pictures.colours)
    depth_times = _stamps_of(found)
    if times and depth_times:
        places = nearest(times, depth_times, slack_s=_DEPTH_SLACK_S)
        pairs = zip(pictures.colours, places, strict=True)
        return DepthPairs(found, {path: found[place] for path, place in pairs if place is not None})
    by_stem = {path.stem: path for path in found}
    by_numbers = _unique({path: _numbers(path) for path in found})
    asking = _unique({path: _numbers(path) for path in pictures.colours})
    numbered = {path: by_numbers[key] for key, path in asking.items() if key in by_numbers}
    named = {path: by_stem[path.stem] for path in pictures.colours if path.stem in by_stem}
    return DepthPairs(found, numbered | named)


def _stamps_of(pictures: Sequence[Path]) -> list[float]:
    """Return the stamps in the names of all pictures, such as 1305031452.791720, if they increase; otherwise nothing.
    Whole numbers only count the pictures.
    """
    if not all(re.fullmatch(r"[0-9]{1,10}\.[0-9]+", path.stem) for path in pictures):
        return []
    stamps = [float(path.stem) for path in pictures]
    return stamps if all(a < b for a, b in pairwise(stamps)) else []


def kinds_of(paths: Iterable[Path]) -> str:
    """Return the endings of files, with the number of files for each."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(p.suffix.lower() for p in paths).items()))


def _conversion(kinds: str) -> str:
    suffix = kinds.split()[-1]
    return f"`magick mogrify -format jpg *{suffix}` writes them as JPEG."


def _sorted_out(folder: Path) -> FolderPictures:
    listed = _listed(folder, IMAGE_SUFFIXES)
    deep = {path for path in listed if _is_deep(path)}
    shallow = {path for path in listed if path not in deep and _DEPTH_NAME.search(path.stem)}
    if len(deep) + len(shallow) == len(listed) and shallow:
        shallow = set()  # A name alone does not make a picture depth if all pictures are called so.
    return FolderPictures(
        colours=[path for path in listed if path not in deep and path not in shallow],
        deep=[path for path in listed if path in deep],
        shallow=[path for path in listed if path in shallow],
        unreadable=_listed(folder, UNREADABLE_SUFFIXES),
    )


def _listed(folder: Path, suffixes: Iterable[str]) -> list[Path]:
    """Return the files of a folder with one of these endings, in natural order: 2 before 10."""
    if not folder.is_dir():
        return []
    found = (path for path in folder.iterdir() if path.suffix.lower() in suffixes and not path.name.startswith("."))
    return sorted(found, key=lambda path: natural_order(path.name))


def _count(folder: Path) -> int:
    return len(_listed(folder, IMAGE_SUFFIXES | UNREADABLE_SUFFIXES))


def _is_deep(path: Path) -> bool:
    """Tell by the header whether a picture has one channel of more than 8 bits; False for pipes and damaged
    pictures."""
    if path.suffix.lower() not in _DEEP_SUFFIXES or not path.is_file():
        return False
    try:
        with path.open("rb") as file, Image.open(file, formats=("PNG", "TIFF")) as header:
            return header.mode in _DEEP_MODES
    except Exception:  # Pillow raises many kinds of errors; damaged images are reported where they are decoded.
        return False


def _is_transparent(path: Path) -> bool:
    """Tell whether every pixel of a PNG is fully transparent; False for other kinds and damaged pictures."""
    if path.suffix.lower() != ".png" or not path.is_file():
        return False
    try:
        with path.open("rb") as file, Image.open(file, formats=("PNG",)) as image:
            if image.mode not in ("RGBA", "LA") or image.width * image.height > MAX_PIXELS:
                return False
            return image.getchannel("A").getextrema()[1] == 0
    except Exception:  # As above.
        return False


def _numbers(path: Path) -> tuple[int, ...]:
    return tuple(int(digits) for digits in re.findall(r"[0-9]+", path.stem))


def _unique(numbers: Mapping[Path, tuple[int, ...]]) -> dict[tuple[int, ...], Path]:
    """Return the files by the numbers in their names, without files that share their numbers with others."""
    counts = Counter(numbers.values())
    return {key: path for path, key in numbers.items() if key and counts[key] == 1}


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """List the pictures and read the tables beside them. Raises DriveError."""
    pictures = colour_pictures(folder, options.rgb)
    paths = pictures.colours
    pairs = DepthPairs((), {}) if options.depth == NOTHING else depth_pairs(folder, options.depth, pictures)
    table = _table(folder, options.odometry)
    stamps, assumed_hz = _known_stamps(paths, table, options)
    described = camera_beside(folder)
    lens = None if options.camera or described.camera else lens_beside(folder)
    frames = [
        ListedFrame(
            colour=str(path.relative_to(folder)),
            moment=FrameMoment(stamp, None if table is None else table.pose(path.name, stamp)),
            depth=None if (depth := pairs.partners.get(path)) is None else str(depth.relative_to(folder)),
            confidence=str(Path(CONFIDENCE_FOLDER) / depth.name)
            if depth is not None and (folder / CONFIDENCE_FOLDER / depth.name).is_file()
            else None,
            lens=None if lens is None else lens.camera,
        )
        for path, stamp in zip(paths, stamps, strict=True)
    ]
    streams = _streams(folder, frames, table, rate_hz(stamps))
    poses = poses_beside(folder, paths)
    used = [*(fact.name for fact in streams), *([] if poses is None else [poses.name])]
    return FileDrive(
        format="folder",
        folder=folder,
        frames=frames,
        streams=streams,
        unread=[*unread_beside(folder, used), *_unread_around(folder)],
        camera=described.camera,
        has_exif=lens is None,
        depth_unit_m=described.metres_per_unit or MILLIMETRES,
        poses=poses,
        assumed_rate_hz=assumed_hz,
        doubts=[
            # For depth among the pictures, `pictures.doubts` has a sentence.
            *(pairs.doubts(paths) if pairs.files is not pictures.deep else ()),
            *([] if table is None else table.doubts),
            *pictures.doubts(frozenset(pairs.partners.values() if options.depth is None else pictures.deep)),
            *(
                [
                    f"{paths[0].name} is fully transparent; the colours below its transparency were used. If no viewer "
                    "shows them, save the pictures without transparency."
                ]
                if _is_transparent(paths[0])
                else []
            ),
        ],
        dropped={_UNREADABLE: len(pictures.unreadable)} if pictures.unreadable else {},
    )


FOLDER = FolderFormat(lambda path: path.is_dir() and most_pictures(path) >= FEWEST, _listed_drive)
"""A plain folder of pictures."""


def _known_stamps(
    pictures: Sequence[Path], table: OdometryTable | None, options: ReadOptions
) -> tuple[list[float], float | None]:
    """Return stamps from the names of the pictures, from the table, or by the rate; and the rate if it was assumed."""
    if options.rate_hz is not None:
        return [place / options.rate_hz for place in range(len(pictures))], None
    of_table = None if table is None else table.stamps_by_place(len(pictures))
    if stamps := _stamps_of(pictures) or of_table:
        return stamps, None
    return [place / RATE_HZ for place in range(len(pictures))], RATE_HZ


def _streams(
    folder: Path, frames: Sequence[ListedFrame], table: OdometryTable | None, rate: float | None
) -> list[SourceFact]:
    found = [SourceFact("rgb", str(Path(frames[0].colour).parent), len(frames), rate)]
    if depths := [frame.depth for frame in frames if frame.depth is not None]:
        found.append(SourceFact("depth", str(Path(depths[0]).parent), len(depths), rate))
    if table is not None:
        found.append(SourceFact("odometry", table.name, len(table)))
    return found


def _unread_around(folder: Path) -> list[SourceFact]:
    """Return what lies around a folder that has the name of one of a drive's, such as `rgb`."""
    around = folder.resolve().parent
    if folder.resolve().name not in IMAGE_FOLDERS:
        return []
    return unread_beside(around, remedy=f"Import the folder {around}, if they belong to these images.")


def _table(folder: Path, wanted: str | None) -> OdometryTable | None:
    if wanted == NOTHING:
        return None
    names = ODOMETRY_FILES if wanted is None else (wanted,)
    path = next((folder / name for name in names if (folder / name).is_file()), None)
    if path is None and wanted is not None:
        path = Path(wanted)
        require_file(path if path.parent.parts else folder / path, "--odometry", "odometry")
    return None if path is None else OdometryTable.read(path)
