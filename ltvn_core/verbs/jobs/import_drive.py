"""`ltvn import`: converts a drive in another format to a recording."""

from tqdm import tqdm

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions, OdometrySource
from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.data.importing.source_camera import read_camera_option
from ltvn_core.sole_writer import sole_writer
from ltvn_core.verbs.import_drive import ImportVerb
from ltvn_core.verbs.verb import Summary


def import_recording(options: ImportVerb) -> Summary:
    """Import the drive; raises DriveError, OptionError and RecordingError."""
    with sole_writer(options.output):
        return _imported(options)


def _imported(options: ImportVerb) -> Summary:
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
