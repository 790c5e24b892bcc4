"""One recording in another format: which formats there are, and that a file or folder appears only when it is whole."""

from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from ltvn_core.atomic_files import atomic_output, new_folder
from ltvn_core.exporting.exported_drive import ExportedDrive
from ltvn_core.exporting.map_files import PlacedMap, placed_map, write_geojson, write_graphml, write_nav2_route
from ltvn_core.extras import naming_the_extra
from ltvn_core.recording.reader import Recording


class ExportFormat(Enum):
    """What a recording can be written as: its drive by the first four, its map by the others."""

    MCAP = "mcap"
    TUM = "tum"
    VINT = "vint"
    LEROBOT = "lerobot"
    GRAPHML = "graphml"
    GEOJSON = "geojson"
    NAV2_ROUTE = "nav2-route"

    @property
    def is_map(self) -> bool:
        """Whether the map is written and not the drive."""
        return self in _MAPS


class Exported(NamedTuple):
    """What was written."""

    frames: int | None
    """Of a drive,"""
    nodes: int | None
    """and of a map."""
    edges: int | None


_MAPS: dict[ExportFormat, Callable[[PlacedMap, Path], None]] = {
    ExportFormat.GRAPHML: write_graphml,
    ExportFormat.GEOJSON: write_geojson,
    ExportFormat.NAV2_ROUTE: write_nav2_route,
}


def export_recording(
    recording: Recording,
    output: Path,
    to: ExportFormat,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
) -> Exported:
    """Write a new file for a map, a new folder for a drive; an output that ends in .mcap is one file.

    Raises RecordingError where `output` exists or cannot be written, MapError where there is no map, and
    MissingLibraryError where a library is missing.
    """
    if to.is_map:
        placed = placed_map(recording)
        with atomic_output(output) as part:
            _MAPS[to](placed, part)
        return Exported(None, len(placed.graph.nodes), len(placed.graph.edges))
    drive = ExportedDrive(recording, from_s=from_s, to_s=to_s)
    write = _writer(to)
    if to is ExportFormat.MCAP:
        _write_bag(drive, output, write)
    else:
        with new_folder(output) as part:
            write(drive, part)
    return Exported(len(drive), None, None)


def _write_bag(drive: ExportedDrive, output: Path, write: Callable[[ExportedDrive, Path], None]) -> None:
    """Write a folder with a bag, or the bag's only file; the library names the file after its folder."""
    with new_folder(output, leave=f"{output.stem}/{output.name}" if output.suffix == ".mcap" else output.name) as part:
        write(drive, part / output.stem if output.suffix == ".mcap" else part / output.name)


def _writer(to: ExportFormat) -> Callable[[ExportedDrive, Path], None]:
    with naming_the_extra():
        match to:
            case ExportFormat.MCAP:
                from ltvn_core.exporting.ros_bag import write_ros_bag as write
            case ExportFormat.LEROBOT:
                from ltvn_core.exporting.lerobot_dataset import write_lerobot_dataset as write
            case ExportFormat.VINT:
                from ltvn_core.exporting.vint_folder import write_vint_folder as write
            case _:
                from ltvn_core.exporting.tum_folder import write_tum_folder as write
    return write
