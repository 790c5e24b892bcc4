"""The files of a LeRobotDataset: its description, its episodes, and their rows.

`layouts` finds the files of an episode. Every path in the data set is resolved within its folder. Owns the encoding of
depth in videos (12 bits per pixel, finer near the camera than far away), and the limit for the part of a Parquet table
in memory at once. The limit is needed because Parquet stores a repeated value once, so a kilobyte of a table can expand
to terabytes.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ltvn_core.data.importing.foreign_files import is_from_lfs, read_foreign, require_plain, require_within
from ltvn_core.data.importing.lerobot.layouts import Episode, Layout, unreadable
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Depth

LARGEST_CODE = 4095
_MOST_ROWS = 32
_BYTES_AT_ONCE = 2**28
_MOST_PART_BYTES = 2**29
"""Largest size in bytes of a column in one row group; a whole LeRobotDataset file has a fifth of it."""
_MOST_NUMBERS = 1024
"""Largest number of values in a cell, as for the joints of a robot."""
INFO = "meta/info.json"
_MOST_BYTES = 20_000_000
_LARGEST_CHUNK = 10**6
_USUAL_CHUNK = 1000
"""Default number of episodes in a folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCodes:
    """Meaning of the codes 0 to 4095 in metres. Code 0 also stands for smaller depths, and for no return."""

    depth_min: float = 0.01
    """Depth at code 0, in metres."""
    depth_max: float = 10.0
    """Depth at the largest code, in metres."""
    shift: float = 3.5
    """Offset in metres that is added before taking the logarithm."""
    use_log: bool = True
    """Whether codes are logarithmic, with steps that grow with the distance; otherwise all steps are equal."""

    def __post_init__(self) -> None:
        """Check the range. Raises DriveError if it is empty or has no logarithm."""
        numbers = (self.depth_min, self.depth_max, self.shift)
        if not (all(map(math.isfinite, numbers)) and self.depth_max > self.depth_min > -self.shift):
            raise DriveError(
                f"Depth between {self.depth_min} and {self.depth_max} m, shifted by {self.shift}, is not a valid range."
            )

    def metres(self, codes: NDArray[np.uint16]) -> Depth:
        """Return the depth (H, W) in metres for codes (H, W); 0 for no return."""
        low, high = self._ends()
        value = low + codes.astype(np.float32) * ((high - low) / LARGEST_CODE)
        metres = np.exp(value) - self.shift if self.use_log else value
        return np.where((codes > 0) & (metres > 0), metres, 0).astype(np.float32)

    def codes(self, metres: Depth) -> NDArray[np.uint16]:
        """Return the codes for depth (H, W) in metres; values beyond the largest code become no return."""
        low, high = self._ends()
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.log(metres + self.shift) if self.use_log else metres
        codes = np.rint((value - low) / (high - low) * LARGEST_CODE)
        return np.where((metres > 0) & (metres <= self.depth_max), codes.clip(1, LARGEST_CODE), 0).astype(np.uint16)

    def _ends(self) -> tuple[float, float]:
        if not self.use_log:
            return self.depth_min, self.depth_max
        return math.log(self.depth_min + self.shift), math.log(self.depth_max + self.shift)


def rows_at_once(metadata: pq.FileMetaData, columns: Sequence[str]) -> int:
    """Return the number of rows of some columns that may be read at once. Raises DriveError if a column is too
    large."""
    largest = 1
    for group in map(metadata.row_group, range(metadata.num_row_groups)):
        for part in map(group.column, range(group.num_columns)):
            name, size = part.path_in_schema, part.total_uncompressed_size
            if not any(name == each or name.startswith(f"{each}.") for each in columns):
                continue
            if size > _MOST_PART_BYTES or part.num_values > group.num_rows * _MOST_NUMBERS:
                raise DriveError(
                    f"The column {name!s:.80} unpacks to {size:,} bytes and {part.num_values:,} values in "
                    f"{group.num_rows:,} rows, which is too large for a drive."
                )
            largest = max(largest, size)
    # A single value may take up the whole column, so a row is assumed to be as large as the largest stored column.
    return max(1, min(_MOST_ROWS, _BYTES_AT_ONCE // largest))


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """A column of the data set, or a video beside the tables."""

    key: str
    dtype: str
    """Type of the column: `video`, `image`, or a number type."""
    names: tuple[str, ...] = ()
    """Names of the numbers in a row."""
    is_depth: bool = False
    metres_per_unit: float = 0.001
    """Metres per unit of depth images."""
    codes: DepthCodes = field(default_factory=DepthCodes)
    """Depth codes of depth videos."""

    @property
    def is_image(self) -> bool:
        """Whether the column holds images."""
        return self.dtype in ("video", "image")


class LerobotDataset:
    """A data set whose description was read. Raises DriveError where it is damaged or of another version."""

    def __init__(self, folder: Path) -> None:
        """Read the description and the episodes of the data set."""
        self.folder = folder
        path = folder / INFO
        try:
            info = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what="description of a data set"))
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error
        if not isinstance(info, dict):
            raise DriveError(f"{path} describes no data set; expected a JSON object.")
        self.layout = _layout(folder, info)
        fps = info.get("fps")
        if not isinstance(fps, int | float) or not 0 < fps < 10_000:
            raise DriveError(f"fps is {fps!r:.20}, but must be images per second.")
        self.fps = float(fps)
        features = info.get("features")
        if not isinstance(features, dict):
            raise DriveError(f"{folder / INFO} names no features.")
        self.features = {key: _feature(key, said) for key, said in features.items() if isinstance(said, dict)}
        self.episodes = self.layout.episodes()

    def video(self, key: str, episode: Episode) -> Path:
        """Return the file of a video."""
        return self._within(self.layout.video_of(key, episode))

    def rows(self, episode: Episode, columns: Sequence[str]) -> Iterator[Mapping[str, Any]]:
        """Yield the rows of an episode, restricted to some columns."""
        path = self._within(self.layout.table_of(episode))
        wanted = ["episode_index", *columns]
        try:
            with pq.ParquetFile(path) as file:
                missing = [name for name in wanted if name not in file.schema_arrow.names]
                if missing:
                    raise DriveError(f"{path} lacks the columns {', '.join(missing)}.")
                at_once = rows_at_once(file.metadata, wanted)
                for batch in file.iter_batches(batch_size=at_once, columns=wanted):
                    yield from (row for row in batch.to_pylist() if row["episode_index"] == episode.number)
        except (OSError, pa.ArrowException, MemoryError, ValueError) as error:
            raise unreadable(path, error) from error

    def _within(self, name: str) -> Path:
        """Return a file of the data set. Raises DriveError where it is outside of the data set, missing or not a plain
        file."""
        path = self.folder / name
        require_within(path, self.folder)
        try:
            require_plain(path)
        except FileNotFoundError as error:
            missing = " ".join(name.split())
            how_to_get = "Copy the whole data set, with the folders data, meta and videos."
            if is_from_lfs(self.folder):
                how_to_get = f"It is kept in Git LFS: run `git lfs pull` in {self.folder}."
            raise DriveError(f"{self.folder} lacks {missing!s:.160}. {how_to_get}") from error
        except OSError as error:
            raise unreadable(path, error) from error
        return path


def _layout(folder: Path, info: Mapping[str, Any]) -> Layout:
    """Return the layout of a data set's files, by its version. Raises DriveError for an unsupported version."""
    version = str(info.get("codebase_version", ""))
    if not version.startswith(("v2", "v3")):
        raise DriveError(
            f"{folder} is a LeRobotDataset of version {version!r:.20}, but only 2.0, 2.1 and 3 are supported; convert "
            "it with a release of LeRobot that reads it."
        )
    data, video = info.get("data_path"), info.get("video_path")
    if version.startswith("v3"):
        return Layout.of(folder, data, video, None)
    size = info.get("chunks_size", _USUAL_CHUNK)
    if not isinstance(size, int) or not 0 < size <= _LARGEST_CHUNK:
        raise DriveError(f"{folder / INFO}: chunks_size is {size!r:.20}, but must be a number of episodes.")
    return Layout.of(folder, data, video, size)


def _feature(key: str, said: Mapping[str, Any]) -> Feature:
    info = said.get("info") or said.get("video_info")
    info = info if isinstance(info, dict) else {}

    def told(name: str, otherwise: Any) -> Any:
        for found in (said.get(name), info.get(name), info.get(f"video.{name}")):
            if isinstance(found, type(otherwise)) or (isinstance(otherwise, float) and isinstance(found, int)):
                return found
        return otherwise

    usual = DepthCodes()
    names = said.get("names")
    names = next(iter(names.values()), ()) if isinstance(names, dict) else names
    return Feature(
        key=key,
        dtype=str(said.get("dtype", "")),
        names=tuple(map(str, names)) if isinstance(names, list) else (),
        is_depth=told("is_depth_map", False),
        metres_per_unit=1.0 if told("depth_unit", "mm") == "m" else 0.001,
        codes=DepthCodes(
            depth_min=told("depth_min", usual.depth_min),
            depth_max=told("depth_max", usual.depth_max),
            shift=told("shift", usual.shift),
            use_log=told("use_log", usual.use_log),
        ),
    )
