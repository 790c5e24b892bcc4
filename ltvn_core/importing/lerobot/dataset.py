"""The files of a LeRobotDataset: what it says of itself, its episodes, and their rows.

Owns the layout of version 3. Every path that the data set names is looked up within its folder alone.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ltvn_core.errors import DriveError
from ltvn_core.importing.foreign_files import read_foreign, require_plain, require_within
from ltvn_core.importing.lerobot.depth_codes import DepthCodes
from ltvn_core.importing.lerobot.table_limits import rows_at_once

INFO = "meta/info.json"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes"

_MOST_BYTES = 20_000_000
_MOST_EPISODES = 200_000
_PLACE = re.compile(r"\{(chunk_index|file_index|video_key)(?::0?(\d)d)?\}")
_MOST_CELLS = 20_000_000
"""Of a table of episodes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """A column of the data set, or a video beside it."""

    key: str
    dtype: str
    """`video`, `image`, or a kind of number."""
    names: tuple[str, ...] = ()
    """Of the numbers of a row."""
    is_depth: bool = False
    metres_per_unit: float = 0.001
    """Of depth images."""
    codes: DepthCodes = field(default_factory=DepthCodes)
    """Of depth videos."""

    @property
    def is_image(self) -> bool:
        """Whether it holds images."""
        return self.dtype in ("video", "image")


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One drive of the data set."""

    number: int
    length: int
    """Rows."""
    row: Mapping[str, Any]
    """All that the data set says of it: which files, from when to when."""

    def whole(self, name: str) -> int:
        """Return a number of a file. Raises DriveError."""
        value = self.row.get(name)
        if not isinstance(value, int) or not 0 <= value < 10**6:
            raise DriveError(f"Episode {self.number}: {name} is {value!r:.40}, which is no number of a file.")
        return value

    def seconds(self, name: str) -> float:
        """Return a moment of a video. Raises DriveError."""
        value = self.row.get(name)
        if not isinstance(value, int | float) or not 0 <= value < 10**7:
            raise DriveError(f"Episode {self.number}: {name} is {value!r:.40}, which is no time in a video.")
        return float(value)


class LerobotDataset:
    """A data set that was looked into. Raises DriveError where it is damaged or of another version."""

    def __init__(self, folder: Path) -> None:
        """Read what it says of itself, and its episodes."""
        self.folder = folder
        self._info = _read_info(folder)
        self.fps = _positive(self._info.get("fps"), "fps")
        features = self._info.get("features")
        if not isinstance(features, dict):
            raise DriveError(f"{folder / INFO} names no features.")
        self.features = {key: _feature(key, said) for key, said in features.items() if isinstance(said, dict)}
        self.episodes = self._read_episodes()

    def video(self, key: str, episode: Episode) -> Path:
        """Return the file of a video."""
        return self._within(self._info.get("video_path") or VIDEO_PATH, f"videos/{key}/", episode, key)

    def rows(self, episode: Episode, columns: Sequence[str]) -> Iterator[Mapping[str, Any]]:
        """Yield the rows of an episode with some columns."""
        path = self._within(self._info.get("data_path") or DATA_PATH, "data/", episode, "")
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
            raise _unreadable(path, error) from error

    def _read_episodes(self) -> list[Episode]:
        files = sorted((self.folder / EPISODES).glob("chunk-*/file-*.parquet"))
        episodes: list[Episode] = []
        for path in files:
            self._check_within(path)
            try:
                with pq.ParquetFile(path) as file:
                    names = _numeric_columns(file.schema_arrow)
                    rows = file.metadata.num_rows
                    if rows > _MOST_EPISODES or rows * len(names) > _MOST_CELLS:
                        raise DriveError(f"{path} has {rows:,} episodes with {len(names):,} numbers each.")
                    episodes += [_episode(row) for row in file.read(columns=names).to_pylist()]
            except (OSError, pa.ArrowException, MemoryError, ValueError) as error:
                raise _unreadable(path, error) from error
        if not episodes:
            raise DriveError(f"{self.folder} has no episodes in {EPISODES}.")
        return episodes

    def _within(self, template: object, prefix: str, episode: Episode, key: str) -> Path:
        values = {
            "chunk_index": episode.whole(f"{prefix}chunk_index"),
            "file_index": episode.whole(f"{prefix}file_index"),
        }

        def filled(place: re.Match[str]) -> str:
            name, digits = place.groups()
            return key if name == "video_key" else f"{values[name]:0{int(digits or 1)}d}"

        path = self.folder / _PLACE.sub(filled, str(template))
        self._check_within(path)
        return path

    def _check_within(self, path: Path) -> None:
        require_within(path, self.folder)
        try:
            require_plain(path)
        except OSError as error:
            raise _unreadable(path, error) from error


def _read_info(folder: Path) -> Mapping[str, Any]:
    path = folder / INFO
    try:
        info = json.loads(read_foreign(path, most_bytes=_MOST_BYTES, what="description of a data set"))
    except (OSError, ValueError, RecursionError) as error:
        raise _unreadable(path, error) from error
    if not isinstance(info, dict) or not str(info.get("codebase_version", "")).startswith("v3"):
        version = info.get("codebase_version") if isinstance(info, dict) else None
        raise DriveError(
            f"{folder} is a LeRobotDataset of version {version!r:.20}, and v3 is read; convert it with LeRobot's own "
            "lerobot.datasets.v30.convert_dataset_v21_to_v30."
        )
    return info


def _numeric_columns(schema: pa.Schema) -> list[str]:
    """Return the columns of single numbers; texts and lists say not where an episode is, and may be of any size."""
    return [
        each.name
        for each in schema
        if (pa.types.is_integer(each.type) or pa.types.is_floating(each.type)) and not each.name.startswith("stats/")
    ]


def _feature(key: str, said: Mapping[str, Any]) -> Feature:
    info = said.get("info") or said.get("video_info")
    info = info if isinstance(info, dict) else {}

    def told(name: str, otherwise: Any) -> Any:
        for found in (said.get(name), info.get(name), info.get(f"video.{name}")):
            if isinstance(found, type(otherwise)) or (isinstance(otherwise, float) and isinstance(found, int)):
                return found
        return otherwise

    usual = DepthCodes()
    return Feature(
        key=key,
        dtype=str(said.get("dtype", "")),
        names=_names(said.get("names")),
        is_depth=told("is_depth_map", False),
        metres_per_unit=1.0 if told("depth_unit", "mm") == "m" else 0.001,
        codes=DepthCodes(
            depth_min=told("depth_min", usual.depth_min),
            depth_max=told("depth_max", usual.depth_max),
            shift=told("shift", usual.shift),
            use_log=told("use_log", usual.use_log),
        ),
    )


def _names(said: object) -> tuple[str, ...]:
    if isinstance(said, dict):
        said = next(iter(said.values()), ())
    return tuple(map(str, said)) if isinstance(said, list) else ()


def _episode(row: Mapping[str, Any]) -> Episode:
    number, length = row.get("episode_index"), row.get("length")
    if not isinstance(number, int) or not isinstance(length, int):
        raise DriveError(f"An episode has the number {number!r:.20} and the length {length!r:.20}.")
    return Episode(number=number, length=length, row=row)


def _positive(value: object, name: str) -> float:
    if not isinstance(value, int | float) or not 0 < value < 10_000:
        raise DriveError(f"{name} is {value!r:.20}, and must be images a second.")
    return float(value)


def _unreadable(path: Path, error: Exception) -> DriveError:
    return DriveError(f"{path} cannot be read ({' '.join(str(error).split())!s:.120}).")
