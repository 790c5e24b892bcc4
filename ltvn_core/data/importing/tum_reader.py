"""Reads folders in the layout of the TUM RGB-D benchmark, which many SLAM programs write and read.

`rgb.txt` and `depth.txt` list stamps and images, and `groundtruth.txt` lists poses of the camera's optical frame; the
depth images are 16-bit PNGs with 5000 units per metre. Depth and poses may be missing. Sturm et al., IROS 2012.
"""

import re
from pathlib import Path

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import lens_beside, read_lens
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
    truths = folder / "groundtruth.txt"
    truth = PoseTrack.read(truths) if truths.is_file() else None
    odometry = _odometry_track(folder, options.odometry, doubts)
    tracks = [
        (role, name, track, said)
        for role, name, track, said in (
            ("truth", "groundtruth.txt", truth, "groundtruth.txt"),
            ("odometry", "odometry", odometry, "the odometry"),
        )
        if track is not None
    ]
    described = camera_beside(folder)
    # The benchmark's own camera, if the folder has the name of one of its sequences.
    named = _BENCHMARK_NAME.search(folder.resolve().name)
    camera = options.camera or described.camera or (BENCHMARK_CAMERAS[named.group(1)] if named else None)
    lens = None
    if camera is None:
        calibration = folder / CALIBRATION_FILE
        lens = read_lens(calibration) if calibration.is_file() else lens_beside(folder)
    stamps = [stamp for stamp, _ in colours]
    depth_stamps = [stamp for stamp, _ in depths]
    partners = nearest(stamps, depth_stamps, slack_s=SLACK_S)
    frames = [
        ListedFrame(
            colour=name,
            moment=_moment(stamp, truth, odometry),
            depth=None if partner is None else depths[partner][1],
            lens=None if lens is None else lens.camera,
        )
        for (stamp, name), partner in zip(colours, partners, strict=True)
    ]
    streams = [SourceFact("rgb", "rgb.txt", len(stamps), rate_hz(stamps))]
    if depths:
        streams.append(SourceFact("depth", "depth.txt", len(depths), rate_hz(depth_stamps)))
    unread = unread_beside(folder, [stream.name for stream in streams])
    streams += [SourceFact(role, name, len(each.stamps), rate_hz(each.stamps)) for role, name, each, _ in tracks]
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
            *(track.doubt for _, _, track, _ in tracks if track.doubt),
            *apart_in_time(stamps, depth_stamps, "depth.txt", slack_s=SLACK_S),
            *(s for *_, track, said in tracks for s in apart_in_time(stamps, track.stamps, said, slack_s=SLACK_S)),
            *doubts,
            *(
                f"The camera is upright only if {track.up_axis} is the up axis of its poses, so that axis was used; "
                "TUM's files have z up."
                for _, _, track, _ in tracks
                if track.up_axis != "z"
            ),
        ],
    )


TUM = FolderFormat(lambda path: (path / "rgb.txt").is_file(), _listed_drive)
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
    # Lists from Windows have backslashes.
    return [
        (stamp, file.replace("\\", "/") if "\\" in file and not (folder / file).is_file() else file)
        for stamp, (file, *_) in rows
    ]


def _odometry_track(folder: Path, wanted: str | None, doubts: list[str]) -> PoseTrack | None:
    """Return the odometry that the user named, or else the one in the folder, if it can be read."""
    path = folder / (wanted or ODOMETRY_FILE)
    if wanted == NOTHING or (wanted is None and not path.is_file()):
        return None
    if wanted is not None:
        require_file(path, "--odometry", "odometry")
    try:
        return PoseTrack.read(path)
    except DriveError as error:
        if wanted is not None:
            raise
        doubts.append(f"{ODOMETRY_FILE} was left out: {error}")  # Other programs use this name for other files.
        return None
