"""Reads a plain folder of pictures, with or without depth, with or without a table of odometry.

Pictures are read in natural order (2 before 10). Depth images are 16-bit PNGs in millimetres with the names or numbers
of the pictures. They are in `depth/` or in the folder of the pictures, where many programs save both; the pixel format
then tells colours from depth. `odometry.csv` has the columns `file` or `stamp`, `x`, `y`, `yaw`. True poses are read in
the formats of 7-Scenes, ScanNet and Replica (`importing.pose_track`). The lens comes from `camera.json`, or
approximately from the EXIF data of a picture.
"""

import io
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.encoded_images import MAX_PIXELS, decode_colour, heif_exif, is_heif
from ltvn_core.data.importing.file_lens import lens_beside
from ltvn_core.data.importing.foreign_files import read_bytes_within
from ltvn_core.data.importing.image_files import ImageFilesReader
from ltvn_core.data.importing.pose_track import poses_beside
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import camera_beside
from ltvn_core.data.importing.stamped_lists import RATE_HZ, OdometryTable, natural_order, nearest, rate_hz
from ltvn_core.data.importing.unread_files import require_file, unread_beside
from ltvn_core.errors import DriveError
from ltvn_core.types import Depth

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
"""Folder beside the depth of phones, with confidence images of the same names; see `importing.image_files`."""
_FOCAL_35MM_TAG = 0xA405
_EXIF_FOLDER_TAG = 0x8769
_DIAGONAL_35MM = 43.267
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
    """Return the stamps in the names of all pictures, if they increase; otherwise nothing."""
    named = [_stamp_in(path.stem) for path in pictures]
    stamps = [stamp for stamp in named if stamp is not None]
    return stamps if len(stamps) == len(named) and all(a < b for a, b in pairwise(stamps)) else []


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


class FolderReader(ImageFilesReader):
    """A folder of pictures that is open for reading."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """List the pictures and read the tables beside them. Raises DriveError."""
        super().__init__(folder, options)
        pictures = colour_pictures(folder, options.rgb)
        self._pictures = pictures.colours
        self._depth: Mapping[Path, Path] = {}
        if options.depth != NOTHING:
            pairs = depth_pairs(folder, options.depth, pictures)
            self._depth = pairs.partners
            if pairs.files is not pictures.deep:  # For those among the pictures, `pictures.doubts` has a sentence.
                self.doubts += pairs.doubts(self._pictures)
        self._table = _table(folder, options.odometry)
        self.doubts += [] if self._table is None else self._table.doubts
        self._assumed_hz: float | None = None
        self._stamps = self._known_stamps()
        self._truth = poses_beside(folder, self._pictures)
        self._described = camera_beside(folder)
        self._lens = None if options.camera or self._described.camera else lens_beside(folder)
        if pictures.unreadable:
            self.dropped[_UNREADABLE] = len(pictures.unreadable)
        self.doubts += pictures.doubts(frozenset(self._depth.values() if options.depth is None else pictures.deep))
        if _is_transparent(self._pictures[0]):
            self.doubts.append(
                f"{self._pictures[0].name} is fully transparent; the colours below its transparency were used. If no "
                "viewer shows them, save the pictures without transparency."
            )
        if self._truth is not None and self._truth.missing:
            self.doubts.append(f"{self._truth.missing} images have no valid pose in {self._truth.name}.")
        self.facts = DriveFacts(
            format="folder",
            frames=len(self._pictures),
            streams=self._streams(),
            place=folder.resolve().name,
            assumed_rate_hz=self._assumed_hz,
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder with some pictures."""
        try:
            return path.is_dir() and most_pictures(path) >= FEWEST
        except OSError:
            return False

    def _images(self) -> Iterator[tuple[FrameMoment, Path]]:
        for place, path in enumerate(self._pictures):
            yield self._moment(place, path), path

    def _moment(self, place: int, path: Path) -> FrameMoment:
        stamp = self._stamps[place]
        odometry = None if self._table is None else self._table.pose(path.name, stamp)
        truth = None if self._truth is None else self._truth.at(place)
        return FrameMoment.with_truth(stamp, truth, odometry)

    def _frame(self, moment: FrameMoment, image: Path) -> RawFrame:
        name = str(image.relative_to(self._folder))
        blob = read_bytes_within(self._folder, name)
        rgb = decode_colour(blob, name)
        height, width = rgb.shape[:2]
        camera = self._options.camera or self._described.camera
        if camera is None:
            camera = self._lens.camera(width, height) if self._lens else _exif_camera(blob, width, height)
        depth_m = self._if_readable(lambda: self._read_depth(image))
        return self._raw_frame(moment, name, rgb, camera=camera, depth_m=depth_m)

    def _read_depth(self, picture: Path) -> Depth | None:
        path = self._depth.get(picture)
        if path is None:
            return None
        name = str(path.relative_to(self._folder))
        unit = self._options.depth_unit_m or self._described.metres_per_unit or MILLIMETRES
        depth_m = self._depth_m(name, unit)
        beside = Path(CONFIDENCE_FOLDER) / path.name
        return self._without_unsure(depth_m, str(beside)) if (self._folder / beside).is_file() else depth_m

    def _known_stamps(self) -> Sequence[float]:
        """Return stamps from the names of the pictures, from the table, or by the rate."""
        if self._options.rate_hz is None:
            if stamps := _stamps_of(self._pictures):
                return stamps
            if self._table is not None and self._table.stamps_by_place(len(self._pictures)) is not None:
                return self._table.stamps_by_place(len(self._pictures)) or ()
            self._assumed_hz = RATE_HZ
        return [place / (self._options.rate_hz or RATE_HZ) for place in range(len(self._pictures))]

    def _streams(self) -> Sequence[SourceFact]:
        rate = rate_hz(self._stamps)
        found = [SourceFact("rgb", str(self._pictures[0].parent.relative_to(self._folder)), len(self._pictures), rate)]
        if self._depth:
            where = next(iter(self._depth.values())).parent.relative_to(self._folder)
            found.append(SourceFact("depth", str(where), len(self._depth), rate))
        if self._table is not None:
            found.append(SourceFact("odometry", self._table.name, len(self._table), None))
        if self._truth is not None:
            found.append(SourceFact("truth", self._truth.name, len(self._truth), None))
        used = [fact.name for fact in found]
        return [*found, *unread_beside(self._folder, used), *self._unread_around()]

    def _unread_around(self) -> list[SourceFact]:
        """Return what lies around a folder that has the name of one of a drive's, such as `rgb`."""
        around = self._folder.resolve().parent
        if self._folder.resolve().name not in IMAGE_FOLDERS:
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


def _stamp_in(stem: str) -> float | None:
    """Return the seconds in a name such as 1305031452.791720; None for whole numbers, which only count the pictures."""
    return float(stem) if re.fullmatch(r"[0-9]{1,10}\.[0-9]+", stem) else None


def _exif_camera(blob: bytes, width: int, height: int) -> CameraModel | None:
    """Return the lens from the EXIF focal length (35 mm equivalent) of a picture; None if it has none."""
    try:
        if is_heif(blob):
            exif = heif_exif(blob)
        else:
            with Image.open(io.BytesIO(blob)) as image:
                exif = image.getexif()
        focal_mm = float(exif.get_ifd(_EXIF_FOLDER_TAG).get(_FOCAL_35MM_TAG, 0))
    except Exception:  # Untrusted EXIF data may raise anything.
        return None
    if not 5 <= focal_mm <= 1000:
        return None
    focal_px = focal_mm / _DIAGONAL_35MM * (width**2 + height**2) ** 0.5
    return CameraModel(width=width, height=height, fx=focal_px, fy=focal_px, cx=(width - 1) / 2, cy=(height - 1) / 2)
