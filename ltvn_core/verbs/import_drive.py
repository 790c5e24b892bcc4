"""`ltvn import`: somebody else's drive becomes a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class ImportVerb(Verb):
    """Make a recording of a drive in another format: a bag, a data set, a folder of pictures."""

    source: Positional[Path]
    """The file or folder."""
    output: Path
    """The recording to write; must not exist yet."""
    format: str = "auto"
    """The reader to use; auto finds out, and a wrong name lists those there are."""
    rgb: str | None = None
    """Which topic, key or list holds the colour images, where the reader finds the wrong one or several;"""
    depth: str | None = None
    """the depth images, "none" leaves them out;"""
    odometry: str | None = None
    """the odometry, for a folder of pictures a CSV file with the columns file (or stamp), x, y, yaw;"""
    camera_info: str | None = None
    """and the camera's description."""
    camera: str | None = None
    """The lens: fx,fy,cx,cy,width,height and where it is distorted k1,k2,p1,p2,k3; or a camera.json, which
    may say "fisheye": true, and by depth_scale the unit of depth."""
    fov: float | None = None
    """Horizontal field of view in degrees, where nothing else is known of the lens."""
    height: float | None = None
    """Height of the camera above the floor in metres."""
    pitch: float | None = None
    """How the camera is mounted, in degrees; negative looks down."""
    odometry_from: Literal["auto", "source", "truth", "none"] = "auto"
    """What is recorded as odometry: the source's own, the true poses, or nothing; auto is the first that there is."""
    every_m: float = 0.1
    """Keep an image after so many metres by odometry,"""
    every_deg: float = 8.0
    """or degrees of turning; 0 and 0 keep all. Without odometry one is kept where the picture has changed."""
    rate: float | None = None
    """Images a second, for formats without stamps."""
    scene: str = ""
    """What the recording calls the place; by default real: and the source's name."""

    def run(self) -> Summary:
        """Import the drive; raises DriveError, OptionError and RecordingError."""
        from tqdm import tqdm

        from ltvn_core.atomic_files import require_new_path
        from ltvn_core.importing.drive_import import import_drive
        from ltvn_core.importing.drive_odometry import OdometrySource
        from ltvn_core.importing.import_options import ImportOptions
        from ltvn_core.importing.raw_frame import ReadOptions
        from ltvn_core.importing.reader_registry import open_drive
        from ltvn_core.importing.source_camera import read_camera_option

        require_new_path(self.output)
        options = ImportOptions(
            odometry=OdometrySource(self.odometry_from),
            every_m=self.every_m,
            every_deg=self.every_deg,
            fov_deg=self.fov,
            height_m=self.height,
            pitch_deg=self.pitch,
            scene=self.scene,
        )
        camera = None if self.camera is None else read_camera_option(self.camera)
        read = ReadOptions(
            rgb=self.rgb,
            depth=self.depth,
            odometry=self.odometry,
            camera_info=self.camera_info,
            camera=None if camera is None else camera.camera,
            depth_unit_m=None if camera is None else camera.metres_per_unit,
            rate_hz=self.rate,
        )
        drive = open_drive(self.source, self.format, read)
        with tqdm(desc="import", unit="image", total=drive.facts.frames) as bar:

            def show(done: int, total: int | None) -> None:
                bar.total = total
                bar.update(done - bar.n)

            return import_drive(drive, self.output, options, show)
