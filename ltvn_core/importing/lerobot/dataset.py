"""The files of a LeRobotDataset: what it says of itself, its episodes, and their rows.

Where the files of an episode are is in `layouts`. Every path that the data set names is looked up within its folder.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ltvn_core.errors import DriveError
from ltvn_core.importing.foreign_files import is_from_lfs, read_foreign, require_plain, require_within
from ltvn_core.importing.lerobot.depth_codes import DepthCodes
from ltvn_core.importing.lerobot.layouts import Episode, Layout, LayoutV2, LayoutV3, unreadable
from ltvn_core.importing.lerobot.table_limits import rows_at_once
from ltvn_core.structured_text import parse_json

INFO = "meta/info.json"

_MOST_BYTES = 20_000_000
_LARGEST_CHUNK = 10**6


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


class LerobotDataset:
    """A data set that was looked into. Raises DriveError where it is damaged or of another version."""

    def __init__(self, folder: Path) -> None:
        """Read what it says of itself, and its episodes."""
        self.folder = folder
        self._info = _read_info(folder)
        self._layout = _layout(folder, self._info)
        self.fps = _positive(self._info.get("fps"), "fps")
        features = self._info.get("features")
        if not isinstance(features, dict):
            raise DriveError(f"{folder / INFO} names no features.")
        self.features = {key: _feature(key, said) for key, said in features.items() if isinstance(said, dict)}
        self.episodes = self._layout.episodes()

    def video(self, key: str, episode: Episode) -> Path:
        """Return the file of a video."""
        return self._within(self._layout.video(key, episode))

    def video_span(self, key: str, episode: Episode) -> tuple[float, float]:
        """Return from when to when in that video the episode is, in seconds."""
        return self._layout.video_span(key, episode)

    def rows(self, episode: Episode, columns: Sequence[str]) -> Iterator[Mapping[str, Any]]:
        """Yield the rows of an episode with some columns."""
        path = self._within(self._layout.table(episode))
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
        """Return a file of the data set. Raises DriveError where it is elsewhere, missing or no plain file."""
        path = self.folder / name
        require_within(path, self.folder)
        try:
            require_plain(path)
        except FileNotFoundError as error:
            missing = " ".join(name.split())
            raise DriveError(f"{self.folder} lacks {missing!s:.160}. {self._how_to_get()}") from error
        except OSError as error:
            raise unreadable(path, error) from error
        return path

    def _how_to_get(self) -> str:
        if is_from_lfs(self.folder):
            return f"It is kept in Git LFS: run `git lfs pull` in {self.folder}."
        return "Copy the whole data set, with the folders data, meta and videos."


def _read_info(folder: Path) -> Mapping[str, Any]:
    path = folder / INFO
    try:
        info = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what="description of a data set"))
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error
    if not isinstance(info, dict):
        raise DriveError(f"{path} describes no data set; expected a JSON object.")
    return info


def _layout(folder: Path, info: Mapping[str, Any]) -> Layout:
    """Return where the files of a data set are, by its version. Raises DriveError for versions that are not read."""
    version = str(info.get("codebase_version", ""))
    data, video = info.get("data_path"), info.get("video_path")
    if version.startswith("v3"):
        return LayoutV3(folder, data, video)
    if version.startswith("v2"):
        size = info.get("chunks_size", LayoutV2.CHUNK)
        if not isinstance(size, int) or not 0 < size <= _LARGEST_CHUNK:
            raise DriveError(f"{folder / INFO}: chunks_size is {size!r:.20}, and must be a number of episodes.")
        return LayoutV2(folder, data, video, size)
    raise DriveError(
        f"{folder} is a LeRobotDataset of version {version!r:.20}, and versions 2.0, 2.1 and 3 are read; convert it "
        "to one of these with a release of LeRobot that reads it."
    )


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


def _positive(value: object, name: str) -> float:
    if not isinstance(value, int | float) or not 0 < value < 10_000:
        raise DriveError(f"{name} is {value!r:.20}, and must be images a second.")
    return float(value)
