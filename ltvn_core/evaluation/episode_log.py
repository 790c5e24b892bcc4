"""The episodes of an unfinished batch: one line of JSON each, on disk as soon as the episode is over.

Owns that file alone. Several processes that share a folder may append to it; an episode that stands there twice counts
once, since it goes the same way each time.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import cattrs

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.results import EpisodeResult
from ltvn_core.structured_text import parse_json

_CONVERTER = cattrs.Converter(forbid_extra_keys=True)


@dataclass(frozen=True, slots=True)
class LoggedEpisode:
    """A finished episode and how long it took."""

    result: EpisodeResult
    wall_s: float


def read_episodes(path: Path) -> Mapping[int, LoggedEpisode]:
    """Return the finished episodes by number; a line that was cut off is left out, and its episode is run again."""
    if not path.exists():
        return {}
    found = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            logged = _CONVERTER.structure(parse_json(line), LoggedEpisode)
        except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError):
            continue
        found[logged.result.episode] = logged
    return found


def append_episode(path: Path, logged: LoggedEpisode) -> None:
    """Add a finished episode; it is on the disk when this returns. Raises OptionError where it cannot be written."""
    # The line break stands first, so that a line that was cut off spoils no other.
    line = "\n" + json.dumps(asdict(logged), separators=(",", ":"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OptionError(
            f"{path} cannot be written: {error.strerror}. Free some space or name another --folder; what is done is "
            "kept."
        ) from error
