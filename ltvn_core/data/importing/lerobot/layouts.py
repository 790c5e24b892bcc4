"""Layout of the files of a LeRobotDataset: version 3 has many episodes in a file, version 2 one table per episode.

Owns the lists of episodes and the templates of paths. Only known names are filled into a template: it comes from an
untrusted file, and Python's own formatting would look up attributes.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from ltvn_core.data.importing.foreign_files import read_foreign, require_plain, require_within
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json

EPISODES = "meta/episodes"
EPISODE_LINES = "meta/episodes.jsonl"

_PLACE = re.compile(r"\{(chunk_index|file_index|episode_chunk|episode_index|video_key)(?::0?(\d)d)?\}")
_MOST_EPISODES = 200_000
_MOST_CELLS = 20_000_000
"""Largest number of cells in a table of episodes."""
_MOST_LINES_BYTES = 50_000_000
_LARGEST_NUMBER = 10**6


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One drive of the data set."""

    number: int
    length: int
    """Number of rows."""
    row: Mapping[str, Any]
    """The data set's entry for the episode: its files, and its time span in them."""

    def whole(self, name: str) -> int:
        """Return the number of a file, from the field `name`. Raises DriveError."""
        value = self.row.get(name)
        if not isinstance(value, int) or not 0 <= value < _LARGEST_NUMBER:
            raise DriveError(f"Episode {self.number}: {name} is {value!r:.40}, which is not the number of a file.")
        return value

    def seconds(self, name: str) -> float:
        """Return a time in a video in seconds, from the field `name`. Raises DriveError."""
        value = self.row.get(name)
        if not isinstance(value, int | float) or not 0 <= value < 10**7:
            raise DriveError(f"Episode {self.number}: {name} is {value!r:.40}, which is not a time in a video.")
        return float(value)


class Layout(Protocol):
    """Finds the files of a data set; their names are not checked yet."""

    def episodes(self) -> list[Episode]:
        """Return all episodes, at least one. Raises DriveError."""
        ...

    def table(self, episode: Episode) -> str:
        """Return the file with an episode's rows, relative to the data set. Raises DriveError."""
        ...

    def video(self, key: str, episode: Episode) -> str:
        """Return the file with an episode's video, relative to the data set. Raises DriveError."""
        ...

    def video_span(self, key: str, episode: Episode) -> tuple[float, float]:
        """Return the time span of the episode in that file, in seconds. Raises DriveError."""
        ...


class LayoutV3:
    """Version 3: a table gives the file and the time span of each episode."""

    DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"

    def __init__(self, folder: Path, data: object, video: object) -> None:
        """Take the path templates of the data set; None stands for a missing one."""
        self._folder = folder
        self._data = str(data or self.DATA)
        self._video = str(video or self.VIDEO)

    def episodes(self) -> list[Episode]:
        """Read the tables of episodes; see `Layout`."""
        episodes: list[Episode] = []
        for path in sorted((self._folder / EPISODES).glob("chunk-*/file-*.parquet")):
            episodes += self._in_table(path)
        if not episodes:
            raise DriveError(f"{self._folder} has no episodes in {EPISODES}.")
        return episodes

    def table(self, episode: Episode) -> str:
        """Return the file that the table names; see `Layout`."""
        return _filled(self._data, self._numbers("data/", episode))

    def video(self, key: str, episode: Episode) -> str:
        """Return the file that the table names; see `Layout`."""
        return _filled(self._video, {**self._numbers(f"videos/{key}/", episode), "video_key": key})

    def video_span(self, key: str, episode: Episode) -> tuple[float, float]:
        """Return the span in the table; see `Layout`."""
        begin, end = (episode.seconds(f"videos/{key}/{side}_timestamp") for side in ("from", "to"))
        return begin, end

    def _numbers(self, prefix: str, episode: Episode) -> dict[str, int]:
        return {name: episode.whole(f"{prefix}{name}") for name in ("chunk_index", "file_index")}

    def _in_table(self, path: Path) -> Iterator[Episode]:
        require_within(path, self._folder)
        try:
            require_plain(path)
            with pq.ParquetFile(path) as file:
                names = _numeric_columns(file.schema_arrow)
                rows = file.metadata.num_rows
                if rows > _MOST_EPISODES or rows * len(names) > _MOST_CELLS:
                    raise DriveError(f"{path} has {rows:,} episodes with {len(names):,} numbers each.")
                yield from (_episode(row) for row in file.read(columns=names).to_pylist())
        except (OSError, pa.ArrowException, MemoryError, ValueError) as error:
            raise unreadable(path, error) from error


class LayoutV2:
    """Versions 2.0 and 2.1: each episode has a table and videos of its own, which are named by its number."""

    DATA = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    VIDEO = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
    CHUNK = 1000
    """Default number of episodes in a folder."""

    def __init__(self, folder: Path, data: object, video: object, chunk: int) -> None:
        """Take the path templates of the data set (None stands for a missing one), and the number of episodes in a
        folder."""
        self._folder = folder
        self._chunk = chunk
        self._data = str(data or self.DATA)
        self._video = str(video or self.VIDEO)

    def episodes(self) -> list[Episode]:
        """Read the list of episodes; see `Layout`."""
        path = self._folder / EPISODE_LINES
        require_within(path, self._folder)
        try:
            blob = read_foreign(path, most_bytes=_MOST_LINES_BYTES, what="list of episodes")
            lines = [line for line in blob.splitlines() if line.strip()]
            if not 0 < len(lines) <= _MOST_EPISODES:
                raise DriveError(f"{path} lists {len(lines):,} episodes; expected 1 to {_MOST_EPISODES:,}.")
            return [_episode(parse_json(line)) for line in lines]
        except FileNotFoundError as error:
            raise DriveError(f"{self._folder} lacks {EPISODE_LINES}, which lists the episodes.") from error
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error

    def table(self, episode: Episode) -> str:
        """Return the file with the episode's number; see `Layout`."""
        return _filled(self._data, self._numbers(episode))

    def video(self, key: str, episode: Episode) -> str:
        """Return the file with the episode's number; see `Layout`."""
        return _filled(self._video, {**self._numbers(episode), "video_key": key})

    def video_span(self, key: str, episode: Episode) -> tuple[float, float]:
        """Return the whole video; see `Layout`."""
        return 0.0, math.inf

    def _numbers(self, episode: Episode) -> dict[str, int]:
        number = episode.whole("episode_index")
        return {"episode_index": number, "episode_chunk": number // self._chunk}


def _filled(template: str, values: Mapping[str, int | str]) -> str:
    def filled(place: re.Match[str]) -> str:
        name, digits = place.groups()
        value = values.get(name, place.group())
        return value if isinstance(value, str) else f"{value:0{int(digits or 1)}d}"

    return _PLACE.sub(filled, template)


def _numeric_columns(schema: pa.Schema) -> list[str]:
    """Return the columns of single numbers. Texts and lists are not needed to find an episode, and may be very
    large."""
    return [
        each.name
        for each in schema
        if (pa.types.is_integer(each.type) or pa.types.is_floating(each.type)) and not each.name.startswith("stats/")
    ]


def _episode(row: object) -> Episode:
    found = row if isinstance(row, dict) else {}
    number = found.get("episode_index")
    length = found.get("length")
    if not isinstance(number, int) or not isinstance(length, int):
        raise DriveError(f"An episode needs whole numbers, got number {number!r:.20} and length {length!r:.20}.")
    return Episode(number=number, length=length, row=found)


def unreadable(path: Path, error: Exception) -> DriveError:
    """Return a one-line message that a file of the data set cannot be read, with the reason."""
    return DriveError(f"{path} cannot be read ({' '.join(str(error).split())!s:.120}).")
