"""`ltvn import`: converts a drive in another format to a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.sole_writer import sole_writer
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class ImportVerb(Verb):
    """Convert a drive in another format to a recording: a bag, a data set, or a folder of images."""

    source: Positional[Path]
    """The file or folder."""
    output: NewRecording
    """The recording to write; must not exist yet."""
    format: str = "auto"
    """The reader to use; auto detects the format, and a wrong name lists all readers."""
    rgb: str | None = None
    """Topic, key or list of the colour images, if the reader finds none or several."""
    depth: str | None = None
    """Topic, key or list of the depth images; "none" leaves them out."""
    odometry: str | None = None
    """Topic or key of the odometry; for a folder of pictures a CSV file with the columns file (or stamp), x, y, yaw."""
    camera_info: str | None = None
    """Topic, key or file of the camera's description."""
    camera: str | None = None
    """The lens: fx,fy,cx,cy,width,height, followed by k1,k2,p1,p2,k3 if it is distorted. Or a camera.json, which can
    also contain "fisheye": true, and the unit of depth as depth_scale."""
    fov: float | None = None
    """Horizontal field of view in degrees, if nothing else is known about the lens."""
    height: float | None = None
    """Height of the camera above the floor in metres."""
    pitch: float | None = None
    """Pitch of the camera in degrees; negative looks down."""
    odometry_from: Literal["auto", "source", "truth", "none"] = "auto"
    """Source of the recorded odometry: the drive's own (source), the true poses, or none; auto is the first that
    exists."""
    every_m: float = 0.1
    """Distance by odometry after which an image is kept, in metres; if this and --every-deg are 0, all images are kept.
    Without odometry, images are kept when the picture changes."""
    every_deg: float = 8.0
    """Turn by odometry after which an image is kept, in degrees."""
    rate: float | None = None
    """Rate of images per second, for formats without stamps."""
    scene: str = ""
    """Name of the place in the recording; by default "real:" and the name of the source."""

    def run(self) -> Summary:
        """Import the drive; raises DriveError, OptionError and RecordingError."""
        with sole_writer(self.output):
            return _imported(self)


def _imported(options: ImportVerb) -> Summary:
    from tqdm import tqdm

    from ltvn_core.data.importing.drive_import import import_drive
    from ltvn_core.data.importing.import_options import ImportOptions, OdometrySource
    from ltvn_core.data.importing.raw_frame import ReadOptions
    from ltvn_core.data.importing.reader_registry import open_drive
    from ltvn_core.data.importing.source_camera import read_camera_option

    wanted = ImportOptions(
        odometry=OdometrySource(options.odometry_from),
        every_m=options.every_m,
        every_deg=options.every_deg,
        fov_deg=options.fov,
        height_m=options.height,
        pitch_deg=options.pitch,
        scene=options.scene,
    )
    camera = None if options.camera is None else read_camera_option(options.camera)
    read = ReadOptions(
        rgb=options.rgb,
        depth=options.depth,
        odometry=options.odometry,
        camera_info=options.camera_info,
        camera=None if camera is None else camera.camera,
        depth_unit_m=None if camera is None else camera.metres_per_unit,
        rate_hz=options.rate,
    )
    drive = open_drive(options.source, options.format, read)
    with tqdm(desc="import", unit="image", total=drive.facts.frames) as bar:

        def show(done: int, total: int | None) -> None:
            bar.total = total
            bar.update(done - bar.n)

        return import_drive(drive, options.output, wanted, show)
