"""Layout of the files of a LeRobotDataset: version 3 has many episodes in a file, version 2 one table per episode.

Owns the lists of episodes and the templates of paths. Only known names are filled into a template: it comes from an
untrusted file, and Python's own formatting would look up attributes.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import pyarrow as pa
import pyarrow.parquet as pq

from ltvn_core.data.importing.foreign_files import read_foreign, require_plain, require_within
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json

EPISODES = "meta/episodes"
EPISODE_LINES = "meta/episodes.jsonl"
_TABLES = "chunk-*/file-*.parquet"
_USUAL_V3 = (
    "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
)
_USUAL_V2 = (
    "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
    "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
)
"""Templates of the paths of tables and videos, by version."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Finds the files of a data set; their names are not checked yet.
    In version 3, a table gives the file and the time span of each episode. In versions 2.0 and 2.1, each episode has a
    table and videos of its own, which are named by its number.
    """

    folder: Path
    data: str
    """Template of the paths of tables."""
    video: str
    """Template of the paths of videos."""
    chunk: int | None
    """Number of episodes in a folder; None in version 3."""

    @classmethod
    def of(cls, folder: Path, data: object, video: object, chunk: int | None) -> Self:
        """Take the path templates of the data set; None stands for a missing one."""
        usual = _USUAL_V3 if chunk is None else _USUAL_V2
        return cls(folder=folder, data=str(data or usual[0]), video=str(video or usual[1]), chunk=chunk)

    def episodes(self) -> list[Episode]:
        """Return all episodes, at least one. Raises DriveError."""
        if self.chunk is not None:
            return self._listed()
        found = [each for path in sorted((self.folder / EPISODES).glob(_TABLES)) for each in self._in_table(path)]
        if not found:
            raise DriveError(f"{self.folder} has no episodes in {EPISODES}.")
        return found

    def table_of(self, episode: Episode) -> str:
        """Return the file with an episode's rows, relative to the data set. Raises DriveError."""
        return _filled(self.data, self._numbers("data/", episode))

    def video_of(self, key: str, episode: Episode) -> str:
        """Return the file with an episode's video, relative to the data set. Raises DriveError."""
        return _filled(self.video, {**self._numbers(f"videos/{key}/", episode), "video_key": key})

    def video_span(self, key: str, episode: Episode) -> tuple[float, float]:
        """Return the time span of the episode in that file, in seconds. Raises DriveError."""
        if self.chunk is not None:
            return 0.0, math.inf
        begin, end = (episode.seconds(f"videos/{key}/{side}_timestamp") for side in ("from", "to"))
        return begin, end

    def _numbers(self, prefix: str, episode: Episode) -> dict[str, int]:
        if self.chunk is None:
            return {name: episode.whole(f"{prefix}{name}") for name in ("chunk_index", "file_index")}
        number = episode.whole("episode_index")
        return {"episode_index": number, "episode_chunk": number // self.chunk}

    def _in_table(self, path: Path) -> Iterator[Episode]:
        require_within(path, self.folder)
        try:
            require_plain(path)
            with pq.ParquetFile(path) as file:
                # Texts and lists are not needed to find an episode, and may be very large.
                single = [each for each in file.schema_arrow if not each.name.startswith("stats/")]
                names = [x.name for x in single if pa.types.is_integer(x.type) or pa.types.is_floating(x.type)]
                rows = file.metadata.num_rows
                if rows > _MOST_EPISODES or rows * len(names) > _MOST_CELLS:
                    raise DriveError(f"{path} has {rows:,} episodes with {len(names):,} numbers each.")
                yield from map(_episode, file.read(columns=names).to_pylist())
        except (OSError, pa.ArrowException, MemoryError, ValueError) as error:
            raise unreadable(path, error) from error

    def _listed(self) -> list[Episode]:
        path = self.folder / EPISODE_LINES
        require_within(path, self.folder)
        try:
            blob = read_foreign(path, most_bytes=_MOST_LINES_BYTES, what="list of episodes")
            lines = [line for line in blob.splitlines() if line.strip()]
            if not 0 < len(lines) <= _MOST_EPISODES:
                raise DriveError(f"{path} lists {len(lines):,} episodes; expected 1 to {_MOST_EPISODES:,}.")
            return [_episode(parse_json(line)) for line in lines]
        except FileNotFoundError as error:
            raise DriveError(f"{self.folder} lacks {EPISODE_LINES}, which lists the episodes.") from error
        except (OSError, ValueError) as error:
            raise unreadable(path, error) from error


def _filled(template: str, values: Mapping[str, int | str]) -> str:
    def filled(place: re.Match[str]) -> str:
        name, digits = place.groups()
        value = values.get(name, place.group())
        return value if isinstance(value, str) else f"{value:0{int(digits or 1)}d}"

    return _PLACE.sub(filled, template)


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
