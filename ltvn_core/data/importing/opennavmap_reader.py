"""Reads the maps of OpenNavMap: lists of images with a time, a pose and a lens for each.

`poses.txt` holds world-to-camera poses of the optical frame, with w first in the quaternion; `timestamps.txt` holds
seconds, and `intrinsics.txt` fx fy cx cy width height. A depth image is beside each image, as `*.depth.png` in
millimetres. The edges of the map are not read, because the map is rebuilt.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.data.importing.image_files import ImageFilesReader
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.stamped_lists import list_lines, rate_hz
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.types import Depth

POSES = "poses.txt"
STAMPS = "timestamps.txt"
LENSES = "intrinsics.txt"

_UNIT_TOLERANCE = 0.1


class OpenNavMapReader(ImageFilesReader):
    """A map of OpenNavMap that is open for reading, as the drive from which it was made."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Read the lists, but no image yet. Raises DriveError."""
        super().__init__(folder, options)
        stamps = {name: numbers[0] for name, numbers in _rows(folder / STAMPS, columns=1).items()}
        self._stamps = dict(sorted(stamps.items(), key=lambda item: item[1]))
        self._lenses = _rows(folder / LENSES, columns=6) if (folder / LENSES).is_file() else {}
        self._track = _track(folder / POSES, self._stamps)
        rate = rate_hz(list(self._stamps.values()))
        posed = len(self._track.stamps)
        self.facts = DriveFacts(
            format="opennavmap",
            frames=len(self._stamps),
            streams=(SourceFact("rgb", STAMPS, len(self._stamps), rate), SourceFact("truth", POSES, posed, rate)),
            place=folder.resolve().name,
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder with the lists of a map; never raises."""
        try:
            return all((path / name).is_file() for name in (POSES, STAMPS, LENSES))
        except OSError:
            return False

    def _images(self) -> Iterator[tuple[FrameMoment, str]]:
        for name, stamp in self._stamps.items():
            yield FrameMoment.with_truth(stamp, self._track.at(stamp)), name

    def _frame(self, moment: FrameMoment, image: str) -> RawFrame:
        rgb = self._colours(image)
        camera = self._options.camera or self._lens(image)
        depth_m = self._if_readable(lambda: self._read_depth(image))
        return self._raw_frame(moment, image, rgb, camera=camera, depth_m=depth_m)

    def _lens(self, name: str) -> CameraModel | None:
        if name not in self._lenses:
            return None
        fx, fy, cx, cy, width, height = self._lenses[name]
        try:
            return CameraModel(width=int(width), height=int(height), fx=fx, fy=fy, cx=cx, cy=cy)
        except CameraError as error:
            raise DriveError(str(error)) from error

    def _read_depth(self, name: str) -> Depth | None:
        beside = name.rpartition(".color.")[0] + ".depth.png"
        if self._options.depth == NOTHING or ".color." not in name or not (self._folder / beside).is_file():
            return None
        return self._depth_m(beside, MILLIMETRES)


def _rows(path: Path, *, columns: int) -> Mapping[str, list[float]]:
    """Return the numbers of each image. Raises DriveError that names the first invalid line."""
    found: dict[str, list[float]] = {}
    for number, line, words in list_lines(path, "list of images"):
        try:
            numbers = [float(word) for word in words[1 : columns + 1]]
        except ValueError:
            numbers = []
        if len(numbers) < columns or not np.isfinite(numbers).all():
            raise DriveError(f"{path}, line {number}: expected an image and {columns} numbers, got {line!s:.60}.")
        found[words[0]] = numbers
    if not found:
        raise DriveError(f"{path} lists no images; it needs lines of an image and {columns} numbers.")
    return found


def _track(path: Path, stamps: Mapping[str, float]) -> PoseTrack:
    """Return the poses of the images that have a stamp, converted from world-to-camera to camera-to-world."""
    rows = _rows(path, columns=7)
    poses = {stamps[name]: numbers for name, numbers in rows.items() if name in stamps}
    if not poses:
        raise DriveError(
            f"{path} and {STAMPS} name no image in common: {next(iter(rows))!s:.60} and others there, "
            f"{next(iter(stamps))!s:.60} and others here. Write the same names into both."
        )
    order = np.array(sorted(poses))
    numbers = np.array([poses[stamp] for stamp in order.tolist()])
    norms = np.linalg.norm(numbers[:, :4], axis=1)
    if (np.abs(norms - 1) > _UNIT_TOLERANCE).any():
        raise DriveError(f"{path}: a quaternion is not of length 1; the columns are image qw qx qy qz tx ty tz.")
    to_world = Rotation.from_quat(numbers[:, [1, 2, 3, 0]]).inv()
    return PoseTrack(order, -to_world.apply(numbers[:, 4:]), to_world)
