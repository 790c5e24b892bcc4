"""Reads sequences in the ASL layout, used by EuRoC's drone and TUM VI: `mav0/cam0/data/NANOSECONDS.png` and so on.

`data.csv` lists the images, `sensor.yaml` describes the lens and the camera's place on the body, and
`state_groundtruth_estimate0` holds poses of the body in a world whose z is up. Burri et al., IJRR 2016.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.foreign_files import require_own_files
from ltvn_core.data.importing.pose_track import PoseTrack, read_poses
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import CalibrationYaml
from ltvn_core.data.importing.spatial_pose import Transform, inverse
from ltvn_core.data.importing.stamped_lists import apart_in_time, rate_hz, stamped_lines
from ltvn_core.errors import DriveError

TRUTHS = ("state_groundtruth_estimate0", "mocap0", "vicon0")
"""Folders with poses, in order of preference."""

_BODY = "mav0"
_FIRST = "cam0"
_LIST = "data.csv"
_SENSOR = "sensor.yaml"
_IMAGES = "data"
_NANOSECOND = 1e-9
_FISHEYES = ("equidistant", "kannala-brandt")
_DISTORTIONS = ("radial-tangential", "radtan", "plumb_bob", "none", "")


def _listed_drive(path: Path, options: ReadOptions) -> FileDrive:
    """Read the lists, but no image. Raises DriveError."""
    folder = _camera_folder(path, options.rgb)
    body = folder.parent
    require_own_files(body)  # The user may name one camera; poses are beside it.
    images = _images(folder)
    stamps = [stamp for stamp, _ in images]
    sensor = folder / _SENSOR
    said = CalibrationYaml(sensor) if sensor.is_file() else None
    doubts: list[str] = []
    camera = options.camera or (None if said is None else _lens(said, sensor, doubts))
    camera_on_body = None if said is None else said.transform("T_BS")
    streams = [SourceFact("rgb", folder.name, len(stamps), rate_hz(stamps))]
    truth, truth_name = _read_truth(body, np.eye(4) if camera_on_body is None else camera_on_body)
    if truth is not None:
        streams.append(SourceFact("truth", truth_name, len(truth.stamps), rate_hz(truth.stamps)))
        doubts += apart_in_time(stamps, truth.stamps, truth_name, unit="nanoseconds")
    return FileDrive(
        format="euroc",
        folder=folder,
        frames=[
            ListedFrame(colour=name, moment=FrameMoment.with_truth(stamp, None if truth is None else truth.at(stamp)))
            for stamp, name in images
        ],
        streams=streams,
        place=body.resolve().parent.name if body.name == _BODY else body.resolve().name,
        camera=camera,
        doubts=doubts,
    )


EUROC = FolderFormat(
    lambda path: any(_is_camera(each) for each in (path / _BODY / _FIRST, path / _FIRST, path)), _listed_drive
)
"""Sequences in the ASL layout, or one camera of them."""


def _lens(said: CalibrationYaml, path: Path, doubts: list[str]) -> CameraModel | None:
    """Return the lens in a `sensor.yaml`; None, and a doubt, if its kind is not supported. Raises DriveError."""
    model = said.word("camera_model").lower()
    distortion = said.word("distortion_model").lower()
    if model not in ("pinhole", "") or distortion not in (*_FISHEYES, *_DISTORTIONS):
        doubts.append(
            f"The lens in {_SENSOR} is of the kind {model} with {distortion or 'no distortion'}, which is not "
            "supported; give a pinhole lens with --camera."
        )
        return None
    try:
        fx, fy, cx, cy = said.numbers("intrinsics")
        width, height = (int(side) for side in said.numbers("resolution"))
    except ValueError as error:
        raise DriveError(
            f"{path} describes no camera ({error!s:.120}); it needs intrinsics fx, fy, cx, cy and resolution in "
            "pixels. Correct it, or remove it and use --camera."
        ) from error
    coefficients = tuple(said.numbers("distortion_coefficients"))
    lens = FileLens(
        source=str(path),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        size=(width, height),
        distortion=coefficients,
        fisheye=distortion in _FISHEYES,
    )
    return lens.camera(width, height)


def _read_truth(body: Path, camera_on_body: Transform) -> tuple[PoseTrack | None, str]:
    """Return the poses of the camera, and the name of their folder. Raises DriveError."""
    name = next((each for each in TRUTHS if (body / each / _LIST).is_file()), None)
    if name is None:
        return None, ""
    sensor = body / name / _SENSOR
    on_body = CalibrationYaml(sensor).transform("T_BS") if sensor.is_file() else None
    camera_on_sensor = camera_on_body if on_body is None else inverse(on_body) @ camera_on_body
    stamps, positions, turns, _ = read_poses(body / name / _LIST, scalar_first=True, unit_s=_NANOSECOND)
    positions = positions + turns.apply(camera_on_sensor[:3, 3])
    return PoseTrack(stamps, positions, turns * Rotation.from_matrix(camera_on_sensor[:3, :3]), up_axis="z"), name


def _is_camera(folder: Path) -> bool:
    return (folder / _IMAGES).is_dir() and ((folder / _LIST).is_file() or (folder / _SENSOR).is_file())


def _camera_folder(path: Path, wanted: str | None) -> Path:
    """Return the folder of the wanted camera; by default the first camera, or the one that `path` names. Raises
    DriveError."""
    body = next((each for each in (path / _BODY, path, path.parent) if _is_camera(each / (wanted or _FIRST))), None)
    if wanted is None and _is_camera(path):
        return path
    if body is None:
        body = path / _BODY if (path / _BODY).is_dir() else path
        names = sorted(each.name for each in body.iterdir() if _is_camera(each)) if body.is_dir() else []
        raise DriveError(
            f"{body} has no {wanted or _FIRST} with {_IMAGES}/ and {_LIST}; there are {', '.join(names) or 'none'}"
            ". Choose one with --rgb."
        )
    return body / (wanted or _FIRST)


def _images(folder: Path) -> Sequence[tuple[float, str]]:
    """Return stamps in seconds and images in order, from the list, or from the file names if there is no list."""
    listed = folder / _LIST
    if listed.is_file():
        rows, _ = stamped_lines(listed, least_columns=2, unit_s=_NANOSECOND)
        found = [(stamp, f"{_IMAGES}/{words[0]}") for stamp, words in rows]
    else:
        names = sorted((path for path in (folder / _IMAGES).iterdir() if path.stem.isdecimal()), key=lambda p: p.name)
        found = [(int(path.stem[:20]) * _NANOSECOND, f"{_IMAGES}/{path.name}") for path in names]
        found.sort()
    if not found:
        raise DriveError(f"{listed} lists no images; it needs lines of a stamp in nanoseconds and a file.")
    return found
