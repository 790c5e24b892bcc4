"""Reads folders in the layout of the TUM RGB-D benchmark, which many SLAM programs write and read.

`rgb.txt` and `depth.txt` list stamps and images, and `groundtruth.txt` lists poses of the camera's optical frame; the
depth images are 16-bit PNGs with 5000 units per metre. Depth and poses may be missing. Sturm et al., IROS 2012.
"""

import re
from pathlib import Path

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens, lens_beside, read_lens
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import NOTHING, FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import camera_beside
from ltvn_core.data.importing.stamped_lists import apart_in_time, nearest, rate_hz, stamped_lines
from ltvn_core.data.importing.unread_files import require_file, unread_beside
from ltvn_core.errors import DriveError

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


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the lists, but no image. Raises DriveError."""
    doubts: list[str] = []
    colours = _image_list(folder, options.rgb or "rgb.txt", doubts)
    has_depth = options.depth != NOTHING and (options.depth is not None or (folder / "depth.txt").is_file())
    depths = _image_list(folder, options.depth or "depth.txt", doubts) if has_depth else []
    truth = _track(folder / "groundtruth.txt")
    odometry = _odometry_track(folder, options.odometry, doubts)
    described = camera_beside(folder)
    camera = options.camera or described.camera or _benchmark_camera(folder)
    lens = None if camera is not None else _lens(folder)
    stamps = [stamp for stamp, _ in colours]
    partners = nearest(stamps, [stamp for stamp, _ in depths], slack_s=SLACK_S)
    frames = [
        ListedFrame(
            colour=name,
            moment=_moment(stamp, truth, odometry),
            depth=None if partner is None else depths[partner][1],
            lens=None if lens is None else lens.camera,
        )
        for (stamp, name), partner in zip(colours, partners, strict=True)
    ]
    streams = [
        SourceFact(role, name, len(images), rate_hz([stamp for stamp, _ in images]))
        for role, name, images in (("rgb", "rgb.txt", colours), ("depth", "depth.txt", depths))
        if images
    ]
    unread = unread_beside(folder, [stream.name for stream in streams])
    for role, name, track in (("truth", "groundtruth.txt", truth), ("odometry", "odometry", odometry)):
        if track is not None:
            streams.append(SourceFact(role, name, len(track.stamps), rate_hz(track.stamps)))
    return FileDrive(
        format="tum",
        folder=folder,
        frames=frames,
        streams=streams,
        unread=unread,
        camera=camera,
        depth_unit_m=described.metres_per_unit or 1 / UNITS_PER_METRE,
        depth_focal_px=described.depth_focal_px,
        # Those about times are first, because they may be why no image can be used.
        doubts=[
            *(track.doubt for track in (truth, odometry) if track is not None and track.doubt),
            *apart_in_time(stamps, [stamp for stamp, _ in depths], "depth.txt", slack_s=SLACK_S),
            *([] if truth is None else apart_in_time(stamps, truth.stamps, "groundtruth.txt", slack_s=SLACK_S)),
            *([] if odometry is None else apart_in_time(stamps, odometry.stamps, "the odometry", slack_s=SLACK_S)),
            *doubts,
            *_axis_doubts(truth, odometry),
        ],
    )


def _is_tum(path: Path) -> bool:
    return (path / "rgb.txt").is_file()


TUM = FolderFormat(_is_tum, _listed_drive)
"""Folders in TUM's layout: those with a list of colour images."""


def _moment(stamp: float, truth: PoseTrack | None, odometry: PoseTrack | None) -> FrameMoment:
    seen = None if truth is None else truth.at(stamp)
    moved = None if odometry is None else odometry.at(stamp)
    moment = FrameMoment(stamp) if moved is None else FrameMoment(stamp, odometry=moved.planar, tilt=moved.tilt)
    return moment if seen is None else moment._replace(truth=seen.planar, tilt=seen.tilt)


def _image_list(folder: Path, name: str, doubts: list[str]) -> list[tuple[float, str]]:
    """Return the stamps and files of a list, and add a doubt about its stamps. Raises DriveError."""
    rows, doubt = stamped_lines(folder / name, least_columns=2)
    if not rows:
        raise DriveError(f"{folder / name} lists no images; it needs lines of a stamp and a file.")
    doubts += [doubt] if doubt else []
    return [(stamp, _local(folder, words[0])) for stamp, words in rows]


def _odometry_track(folder: Path, wanted: str | None, doubts: list[str]) -> PoseTrack | None:
    """Return the odometry that the user named, or else the one in the folder, if it can be read."""
    if wanted == NOTHING:
        return None
    if wanted is not None:
        require_file(folder / wanted, "--odometry", "odometry")
        return PoseTrack.read(folder / wanted)
    try:
        return _track(folder / ODOMETRY_FILE)
    except DriveError as error:  # Other programs use this name for other files.
        doubts.append(f"{ODOMETRY_FILE} was left out: {error}")
        return None


def _lens(folder: Path) -> FileLens | None:
    calibration = folder / CALIBRATION_FILE
    return read_lens(calibration) if calibration.is_file() else lens_beside(folder)


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
