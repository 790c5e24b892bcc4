"""Reads folders in the layout of the TUM RGB-D benchmark, which many SLAM programs write and read.

`rgb.txt` and `depth.txt` list stamps and images, and `groundtruth.txt` lists poses of the camera's optical frame; the
depth images are 16-bit PNGs with 5000 units per metre. Depth and poses may be missing. Sturm et al., IROS 2012.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.file_lens import lens_beside, read_lens
from ltvn_core.data.importing.image_files import ImageFilesReader
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import camera_beside
from ltvn_core.data.importing.stamped_lists import nearest, rate_hz, stamped_lines
from ltvn_core.data.importing.unread_files import require_file, unread_beside
from ltvn_core.errors import DriveError
from ltvn_core.types import Depth, Rgb

UNITS_PER_METRE = 5000.0
CALIBRATION_FILE = "calibration.txt"
ODOMETRY_FILE = "odometry.txt"
"""Name of the odometry file that `ltvn export` writes; like the true poses, it has poses of the camera's optical
frame."""
SLACK_S = 0.02
"""Least tolerance in seconds for matching colours and depth; it is half a frame if that is longer."""


def _kinect(fx: float, fy: float, cx: float, cy: float, *distortion: float) -> CameraModel:
    return CameraModel(width=640, height=480, fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)


BENCHMARK_CAMERAS = {
    "1": _kinect(517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "2": _kinect(520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "3": _kinect(535.4, 539.2, 320.1, 247.6),
}
"""The benchmark's calibrations of its cameras freiburg1, 2 and 3; the images of the third are already undistorted."""
_BENCHMARK_NAME = re.compile(r"(?:freiburg|fr)([123])(?![0-9])")


class TumReader(ImageFilesReader):
    """A folder in TUM's layout, open for reading."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Read the lists, but no image yet. Raises DriveError."""
        super().__init__(folder, options)
        self._colour = self._image_list(options.rgb or "rgb.txt")
        self._depth = self._depth_list(options.depth)
        self._truth = _track(folder / "groundtruth.txt")
        self._odometry = self._odometry_track(options.odometry)
        self._described = camera_beside(folder)
        self._depth_unit_m = options.depth_unit_m or self._described.metres_per_unit or 1 / UNITS_PER_METRE
        self._camera = options.camera or self._described.camera or _benchmark_camera(folder)
        self._lens = lens_beside(folder) if self._camera is None else None
        self.doubts[:0] = self._time_doubts()  # First, because it may be why no image can be used.
        self.doubts += _axis_doubts(self._truth, self._odometry)
        self.facts = DriveFacts(
            format="tum", frames=len(self._colour), streams=self._streams(), place=folder.resolve().name
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder with a list of colour images."""
        return (path / "rgb.txt").is_file()

    def _images(self) -> Iterator[tuple[FrameMoment, tuple[str, str | None]]]:
        """Yield the moments with the colour image and the depth image of the same time."""
        partners = nearest([stamp for stamp, _ in self._colour], [stamp for stamp, _ in self._depth], slack_s=SLACK_S)
        for (stamp, name), partner in zip(self._colour, partners, strict=True):
            yield self._moment(stamp), (name, None if partner is None else self._depth[partner][1])

    def _image_list(self, name: str) -> list[tuple[float, str]]:
        """Return the stamps and files of a list. Raises DriveError."""
        rows, doubt = stamped_lines(self._folder / name, least_columns=2)
        if not rows:
            raise DriveError(f"{self._folder / name} lists no images; it needs lines of a stamp and a file.")
        self.doubts += [doubt] if doubt else []
        return [(stamp, _local(self._folder, words[0])) for stamp, words in rows]

    def _depth_list(self, wanted: str | None) -> list[tuple[float, str]]:
        if wanted == NOTHING or (wanted is None and not (self._folder / "depth.txt").is_file()):
            return []
        return self._image_list(wanted or "depth.txt")

    def _odometry_track(self, wanted: str | None) -> PoseTrack | None:
        """Return the odometry that the user named, or else the one in the folder, if it can be read."""
        if wanted == NOTHING:
            return None
        if wanted is not None:
            require_file(self._folder / wanted, "--odometry", "odometry")
            return PoseTrack.read(self._folder / wanted)
        try:
            return _track(self._folder / ODOMETRY_FILE)
        except DriveError as error:  # Other programs use this name for other files.
            self.doubts.append(f"{ODOMETRY_FILE} was left out: {error}")
            return None

    def _time_doubts(self) -> Iterator[str]:
        """Yield doubts about stamps, and about lists that do not overlap with the images in time."""
        tracks = (("groundtruth.txt", self._truth), ("the odometry", self._odometry))
        yield from (track.doubt for _, track in tracks if track is not None and track.doubt)
        spans = [(name, track.stamps) for name, track in tracks if track is not None]
        begin = self._colour[0][0]
        end = self._colour[-1][0]
        for name, stamps in [("depth.txt", [stamp for stamp, _ in self._depth]), *spans]:
            if len(stamps) and (stamps[-1] < begin - SLACK_S or stamps[0] > end + SLACK_S):
                yield (
                    f"The images are from {begin:.3f} to {end:.3f} s, {name} from {stamps[0]:.3f} to {stamps[-1]:.3f} "
                    "s, with no moment in common. Write both in seconds of one clock."
                )

    def _moment(self, stamp: float) -> FrameMoment:
        truth = None if self._truth is None else self._truth.at(stamp)
        odometry = None if self._odometry is None else self._odometry.at(stamp)
        known = truth or odometry
        return FrameMoment(
            stamp=stamp,
            odometry=None if odometry is None else odometry.planar,
            truth=None if truth is None else truth.planar,
            tilt=None if known is None else known.tilt,
        )

    def _frame(self, moment: FrameMoment, image: tuple[str, str | None]) -> RawFrame:
        name, depth_name = image
        rgb = self._colours(name)
        depth = None
        if depth_name is not None:
            depth = self._if_readable(lambda: self._depth_m(depth_name, self._depth_unit_m))
        return self._raw_frame(
            moment,
            name,
            rgb,
            depth_m=depth,
            camera=self._known_camera(rgb),
            depth_camera=None if depth is None else self._depth_camera(depth),
        )

    def _known_camera(self, rgb: Rgb) -> CameraModel | None:
        calibration = self._folder / CALIBRATION_FILE
        if self._camera is None and calibration.is_file():
            self._camera = read_lens(calibration).camera(rgb.shape[1], rgb.shape[0])
        elif self._camera is None and self._lens is not None:
            self._camera = self._lens.camera(rgb.shape[1], rgb.shape[0])
        return self._camera

    def _depth_camera(self, depth: Depth) -> CameraModel | None:
        """Return the lens of depth images that are not registered to the colours; None if the folder does not describe
        one."""
        focal = self._described.depth_focal_px
        camera = self._camera
        if focal is None or camera is None:
            return None
        height, width = depth.shape
        focal *= width / camera.width
        return CameraModel(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)

    def _streams(self) -> Sequence[SourceFact]:
        listed = [("rgb", "rgb.txt", self._colour), ("depth", "depth.txt", self._depth)]
        found = [
            SourceFact(role, name, len(images), rate_hz([stamp for stamp, _ in images]))
            for role, name, images in listed
            if images
        ]
        tracks = [("truth", "groundtruth.txt", self._truth), ("odometry", "odometry", self._odometry)]
        return (
            *found,
            *(SourceFact(role, name, len(t.stamps), rate_hz(t.stamps)) for role, name, t in tracks if t is not None),
            *unread_beside(self._folder, [fact.name for fact in found]),
        )


def _local(folder: Path, name: str) -> str:
    """Return a file name from a list in the form of this system; lists from Windows have backslashes."""
    return name.replace("\\", "/") if "\\" in name and not (folder / name).is_file() else name


def _track(path: Path) -> PoseTrack | None:
    return PoseTrack.read(path) if path.is_file() else None


def _benchmark_camera(folder: Path) -> CameraModel | None:
    """Return the benchmark's own camera if the folder has the name of one of its sequences."""
    found = _BENCHMARK_NAME.search(folder.resolve().name)
    return None if found is None else BENCHMARK_CAMERAS[found.group(1)]


def _axis_doubts(*tracks: PoseTrack | None) -> list[str]:
    return [
        f"The camera is upright only if {track.up_axis} is the up axis of its poses, so that axis was used; TUM's "
        "files have z up."
        for track in tracks
        if track is not None and track.up_axis != "z"
    ]
