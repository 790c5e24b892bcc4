"""Interface of the readers of foreign formats: raw frames, facts about a drive, and doubts.

Owns the contract between readers and the rest of importing, but no format. A reader is one module; its class, or its
`file_drive.FolderFormat`, is found by the entry-point group `ltvn.readers`, as `name = "package.module:ReaderClass"`.
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
    """One image of the source, of any size, with all data of the same moment."""

    stamp: float
    """Time on the source's clock, in seconds."""
    rgb: Rgb
    """Colours (H, W, 3), with the distortion and rotation of the camera's image."""
    depth_m: Depth | None = None
    """Depth (h, w) in metres along the optical axis, 0 = no return; None without a depth image. If `depth_camera` is
    None, depth is registered to `rgb`, perhaps at another size."""
    camera: CameraModel | None = None
    """Camera of `rgb`, at its size; None if the source does not describe it."""
    depth_camera: CameraModel | None = None
    """Camera of `depth_m`, at its size, if depth is not registered to the colours; only its lens is used."""
    odometry: Pose | None = None
    """Pose (3,) of the robot in the odometry frame; drifts."""
    truth: Pose | None = None
    """True pose (3,) in a world frame whose z is up."""
    tilt: Tilt | None = None
    """Tilt of the camera at that time, if it changes; see `spatial_pose`."""
    name: str = ""
    """Name of the frame in messages: a file, or a topic and a number."""


class FrameMoment(NamedTuple):
    """Time and pose of an image, if they are known before the image is decoded."""

    stamp: float
    """Time on the source's clock, in seconds."""
    odometry: Pose | None = None
    """Pose (3,) by odometry; None if it is unknown."""
    truth: Pose | None = None
    """True pose (3,); None if it is unknown."""
    tilt: Tilt | None = None

    @classmethod
    def of(cls, frame: RawFrame) -> "FrameMoment":
        """Return the moment of a frame."""
        return cls(frame.stamp, frame.odometry, frame.truth, frame.tilt)

    @classmethod
    def with_truth(cls, stamp: float, truth: SpatialPose | None, odometry: Pose | None = None) -> "FrameMoment":
        """Return the moment of an image from the true pose of its camera in space, which may be unknown (None)."""
        return cls(stamp, odometry) if truth is None else cls(stamp, odometry, truth.planar, truth.tilt)


NO_POSE = "no pose at that time"
NO_DEPTH = "no depth image at that time"
NOT_LATER = "not later than the image before"
"""Reasons for which several readers leave out images."""
NOTHING = "none"
"""Value of an option that excludes a stream."""
FrameFilter: TypeAlias = Callable[[FrameMoment], bool]
"""Tells whether the image of a moment is wanted; called once for each image, in order."""


@dataclass(frozen=True, slots=True)
class SourceFact:
    """One stream that a reader found: a topic, a track, a list of files, a column."""

    role: str
    """Role: `rgb`, `depth`, `odometry`, `truth`, `camera_info`, `tilt`, or "" for an unused stream."""
    name: str
    """Name of the topic, file or column."""
    count: int | None = None
    """Number of messages or files; None if it is unknown."""
    rate_hz: float | None = None
    """Number of messages per second, if they have stamps."""
    could_be: str = ""
    """Role that an unused stream could have; the option of that name selects it, unless `remedy` says otherwise."""
    kind: str = ""
    """What it is, such as a message type; empty if the name says it."""
    remedy: str = ""
    """How an unused stream can be used, in a whole sentence, if not by an option."""

    @property
    def described(self) -> str:
        """The name, with its kind in brackets."""
        return f"{self.name} ({self.kind})" if self.kind else self.name


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
    """Default name of the drive: the name of its file or folder."""
    odometry_frame: str = ""
    """Name of the odometry frame in the source, such as `odom`; empty if it is unknown."""

    assumed_rate_hz: float | None = None
    """Number of images per second that was assumed, because they have no stamps; None if they have, or the user gave
    it."""

    def unread(self, role: str) -> Sequence[SourceFact]:
        """Return what lies in the source and is not read, though it could have a role."""
        return [stream for stream in self.streams if not stream.role and stream.could_be == role]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """The user's options for a drive; the reader decides about those that are None."""

    rgb: str | None = None
    """Topic, key or folder of the colour images."""
    depth: str | None = None
    """Topic, key or folder of the depth images; "none" leaves depth out."""
    odometry: str | None = None
    """Topic or key of the odometry; a CSV file for a folder of pictures."""
    camera_info: str | None = None
    """Topic, key or file of the camera's description."""
    camera: CameraModel | None = None
    """Camera of the colour images, which overrides the source's. Readers scale it to the images if the aspect ratio
    agrees (`source_camera.fitted`)."""
    depth_unit_m: float | None = None
    """Metres per unit of the depth images, which overrides the source's value."""
    rate_hz: float | None = None
    """Images per second, for formats without stamps."""


class DriveReader(Protocol):
    """A drive that is open for reading. Its class also has the two class methods of `ReaderClass`."""

    @property
    def facts(self) -> DriveFacts:
        """Return the facts, known before the first frame is read."""
        ...

    @property
    def dropped(self) -> Mapping[str, int]:
        """Return the number of images left out so far, by reason in a few words; grows while frames are read."""
        ...

    @property
    def doubts(self) -> Sequence[str]:
        """Return the doubts about the drive, in whole sentences with advice; complete once all frames are read."""
        ...

    def frames(self) -> Iterator[RawFrame]:
        """Yield the frames in the order of their stamps, once; damaged frames are counted in `dropped` and left out.

        Raises DriveError if no frame can be read.
        """
        ...


@runtime_checkable
class SelectiveReader(Protocol):
    """A drive that decodes only the images that are wanted; most images of a slow robot are not."""

    def frames_where(self, wanted: FrameFilter) -> Iterator[RawFrame]:
        """Yield the frames of the wanted moments, in the same way as `DriveReader.frames`."""
        ...


class ReaderClass(Protocol):
    """The class that an entry of `ltvn.readers` names: it recognises its format and opens it."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path looks like this format, by file names and first bytes alone; never raises."""
        ...

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> DriveReader:
        """Open a drive. Raises DriveError with the problem, and the option or file that would help."""
        ...
