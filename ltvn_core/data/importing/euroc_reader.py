"""Reads sequences in the ASL layout, used by EuRoC's drone and TUM VI: `mav0/cam0/data/NANOSECONDS.png` and so on.

`data.csv` lists the images, `sensor.yaml` describes the lens and the camera's place on the body, and
`state_groundtruth_estimate0` holds poses of the body in a world whose z is up. Burri et al., IJRR 2016.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.foreign_files import require_own_files
from ltvn_core.data.importing.image_files import ImageFilesReader
from ltvn_core.data.importing.pose_track import PoseTrack, read_poses
from ltvn_core.data.importing.raw_frame import DriveFacts, FrameMoment, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import CalibrationYaml
from ltvn_core.data.importing.spatial_pose import Transform, inverse
from ltvn_core.data.importing.stamped_lists import rate_hz, stamped_lines
from ltvn_core.errors import CameraError, DriveError

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


class EurocReader(ImageFilesReader):
    """A sequence in the ASL layout, open for reading."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        """Read the lists, but no image yet. Raises DriveError."""
        super().__init__(_camera_folder(path, options.rgb), options)
        self._body = self._folder.parent
        require_own_files(self._body)  # The user may name one camera; poses are beside it.
        self._listed = _images(self._folder)
        sensor = self._folder / _SENSOR
        said = CalibrationYaml(sensor) if sensor.is_file() else None
        self._camera = options.camera or (None if said is None else self._lens(said))
        camera_on_body = None if said is None else said.transform("T_BS")
        self._truth, truth_name = self._read_truth(np.eye(4) if camera_on_body is None else camera_on_body)
        self._doubt_times(truth_name)
        stamps = [stamp for stamp, _ in self._listed]
        streams = [SourceFact("rgb", self._folder.name, len(stamps), rate_hz(stamps))]
        if self._truth is not None:
            found = self._truth.stamps
            streams.append(SourceFact("truth", truth_name, len(found), rate_hz(found)))
        place = self._body.resolve().parent.name if self._body.name == _BODY else self._body.resolve().name
        self.facts = DriveFacts(format="euroc", frames=len(stamps), streams=streams, place=place)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder in the ASL layout, or one camera of it; never raises."""
        try:
            return any(_is_camera(each) for each in (path / _BODY / _FIRST, path / _FIRST, path))
        except OSError:
            return False

    def _images(self) -> Iterator[tuple[FrameMoment, str]]:
        for stamp, name in self._listed:
            yield FrameMoment.with_truth(stamp, None if self._truth is None else self._truth.at(stamp)), name

    def _frame(self, moment: FrameMoment, image: str) -> RawFrame:
        return self._raw_frame(moment, image, self._colours(image), camera=self._camera)

    def _lens(self, said: CalibrationYaml) -> CameraModel | None:
        """Return the lens in a `sensor.yaml`; None if its camera model is not supported. Raises DriveError."""
        model = said.word("camera_model").lower()
        distortion = said.word("distortion_model").lower()
        if model not in ("pinhole", "") or distortion not in (*_FISHEYES, *_DISTORTIONS):
            self.doubts.append(
                f"The lens in {_SENSOR} is of the kind {model} with {distortion or 'no distortion'}, which is not "
                "supported; give a pinhole lens with --camera."
            )
            return None
        focal = said.numbers("intrinsics")
        size = said.numbers("resolution")
        try:
            fx, fy, cx, cy = focal
            width, height = (int(side) for side in size)
            is_fisheye = distortion in _FISHEYES
            coefficients = tuple(said.numbers("distortion_coefficients"))
            return CameraModel(
                width=width,
                height=height,
                fx=fx,
                fy=fy,
                cx=cx,
                cy=cy,
                distortion=coefficients if is_fisheye or any(coefficients) else (),
                fisheye=is_fisheye,
            )
        except (ValueError, CameraError) as error:
            raise DriveError(
                f"{self._folder / _SENSOR} describes no camera ({error!s:.120}); it needs intrinsics fx, fy, cx, cy "
                "and resolution in pixels. Correct it, or remove it and use --camera."
            ) from error

    def _read_truth(self, camera_on_body: Transform) -> tuple[PoseTrack | None, str]:
        """Return the poses of the camera, and the name of their folder. Raises DriveError."""
        for name in TRUTHS:
            path = self._body / name / _LIST
            if not path.is_file():
                continue
            sensor = self._body / name / _SENSOR
            on_body = CalibrationYaml(sensor).transform("T_BS") if sensor.is_file() else None
            return _track(path, (np.eye(4) if on_body is None else inverse(on_body)) @ camera_on_body), name
        return None, ""

    def _doubt_times(self, truth_name: str) -> None:
        if self._truth is None:
            return
        begin = self._listed[0][0]
        end = self._listed[-1][0]
        stamps = self._truth.stamps
        if stamps[-1] < begin or stamps[0] > end:
            self.doubts.append(
                f"The images are from {begin:.3f} to {end:.3f} s, {truth_name} from {stamps[0]:.3f} to "
                f"{stamps[-1]:.3f} s, with no moment in common. Write both in nanoseconds of one clock."
            )


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


def _track(path: Path, camera_on_sensor: Transform) -> PoseTrack:
    """Return the poses of a camera from a file with the poses of the sensor that it is mounted on. Raises
    DriveError."""
    of_sensor = read_poses(path, scalar_first=True, unit_s=_NANOSECOND)
    positions = of_sensor.positions + of_sensor.rotations.apply(camera_on_sensor[:3, 3])
    turns = of_sensor.rotations * Rotation.from_matrix(camera_on_sensor[:3, :3])
    return PoseTrack(of_sensor.stamps, positions, turns, up_axis="z")
