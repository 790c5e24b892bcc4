"""Output of the readers of foreign formats: raw frames, and what was found and left out.

Owns the contract between readers and the rest of importing, and no format. A reader is one module; its class is found
by the entry-point group `ltvn.readers`, where an entry is `name = "package.module:ReaderClass"`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.spatial_pose import SpatialPose
from ltvn_core.types import Depth, Pose, Rgb, Tilt


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawFrame:
    """One image of the source, of any size, with all data of the same instant."""

    stamp: float
    """Seconds on the source's clock."""
    rgb: Rgb
    """(H, W, 3), distorted and turned as the camera delivered it."""
    depth_m: Depth | None = None
    """(h, w) metres along the optical axis, 0 = no return; None without a depth image. Where `depth_camera` is None it
    shows what `rgb` shows, perhaps at another size."""
    camera: CameraModel | None = None
    """The camera of `rgb`, at its size; None if the source does not say."""
    depth_camera: CameraModel | None = None
    """The camera of `depth_m`, at its size, where it is not registered to the colours; its lens alone matters."""
    odometry: Pose | None = None
    """(3,) of the robot in the odometry frame; drifts."""
    truth: Pose | None = None
    """(3,) true pose in a world frame whose z is up."""
    tilt: Tilt | None = None
    """Tilt of the camera at that time, if it changes; see `spatial_pose`."""
    name: str = ""
    """Name of the frame in messages: a file, or a topic and a number."""


class FrameMoment(NamedTuple):
    """When and where an image was taken, as far as that is known before the image is decoded."""

    stamp: float
    """Seconds on the source's clock."""
    odometry: Pose | None = None
    """(3,)"""
    truth: Pose | None = None
    """(3,)"""
    tilt: Tilt | None = None

    @classmethod
    def of(cls, frame: RawFrame) -> "FrameMoment":
        """Return the moment of a frame."""
        return cls(frame.stamp, frame.odometry, frame.truth, frame.tilt)

    @classmethod
    def with_truth(cls, stamp: float, truth: SpatialPose | None, odometry: Pose | None = None) -> "FrameMoment":
        """Return the moment of an image whose camera was at a true pose in space, if that is known."""
        return cls(stamp, odometry) if truth is None else cls(stamp, odometry, truth.planar, truth.tilt)


NOTHING = "none"
"""Value of an option that leaves a stream out."""
FrameFilter: TypeAlias = Callable[[FrameMoment], bool]
"""Tells whether the image of a moment is wanted; asked once for each image, in their order."""


@dataclass(frozen=True, slots=True)
class SourceFact:
    """One stream that a reader found: a topic, a list of files, a column."""

    role: str
    """`rgb`, `depth`, `odometry`, `truth`, `camera_info`, `tilt`, or "" for one that is not used."""
    name: str
    """The topic, file or column."""
    count: int | None = None
    """Messages or files."""
    rate_hz: float | None = None
    """Number of messages per second, if they have stamps."""
    could_be: str = ""
    """The role that an unused stream could have too, for the option of that name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFacts:
    """Facts about a drive that are known before the images are read."""

    format: str
    """Name of the reader."""
    frames: int | None = None
    """Number of images to read, for the progress bar; None if unknown."""
    streams: Sequence[SourceFact] = ()
    """Streams that were found; `--rgb`, `--depth` and `--odometry` choose among them."""
    place: str = ""
    """Default name of the drive: the name of the file or folder."""
    odometry_frame: str = ""
    """Name of the odometry frame in the source, such as `odom`; empty if it has none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """The user's options for a drive; None lets the reader find out."""

    rgb: str | None = None
    """Topic, key or folder of the colour images."""
    depth: str | None = None
    """Topic, key or folder of the depth images; "none" leaves depth out."""
    odometry: str | None = None
    """Topic or key of the odometry; a CSV file for a folder of pictures."""
    camera_info: str | None = None
    """Topic, key or file of the camera's description."""
    camera: CameraModel | None = None
    """The camera of the colour images; wins over what the source says. Readers scale it to the images they find where
    the aspect agrees (`source_camera.fitted`)."""
    depth_unit_m: float | None = None
    """Metres per unit of the depth images; wins over what the source says."""
    rate_hz: float | None = None
    """Images a second, for formats without stamps."""


class DriveReader(Protocol):
    """A drive that is open for reading. Its class also has the two class methods of `ReaderClass`."""

    @property
    def facts(self) -> DriveFacts:
        """Return the facts, known before the first frame is read."""
        ...

    @property
    def dropped(self) -> Mapping[str, int]:
        """Return the number of images left out so far by reason, in a few words; grows while frames are read."""
        ...

    @property
    def doubts(self) -> Sequence[str]:
        """Return what is doubtful, in whole sentences with advice; complete once all frames are read."""
        ...

    def frames(self) -> Iterator[RawFrame]:
        """Yield the frames in the order of their stamps, once; a damaged one is counted in `dropped` and left out.

        Raises DriveError where nothing can be read.
        """
        ...


@runtime_checkable
class SelectiveReader(Protocol):
    """A drive whose images are decoded only where they are wanted; most of a slow robot's are not."""

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames as `DriveReader.frames` does, without those whose moment is not wanted."""
        ...


class ReaderClass(Protocol):
    """The class that an entry of `ltvn.readers` names: it recognises its format and opens it."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path looks like this format, by names and the first bytes alone; never raises."""
        ...

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> DriveReader:
        """Open a drive. Raises DriveError that says what is wrong, and which option or file would help."""
        ...
