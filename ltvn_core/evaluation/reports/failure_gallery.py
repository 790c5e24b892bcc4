"""The gallery of failed episodes: selects episodes to show, with images and recordings if there are any.

Owns the contents of a row. Its layout is in the page's template.
"""

import re
import shlex
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.reports.result_rows import grouped, order_of, scene_name, setup_of
from ltvn_core.evaluation.results import TestedMap

_QUESTION = "edge"
"""Name of the debugger's question “What about this edge?”."""
_MIME_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}


@dataclass(frozen=True, slots=True, eq=False)
class FailureRow:
    """One failed episode in the gallery."""

    trial: TestedMap
    episode: QueryResult
    start: bytes | None = None
    """The robot's first image, JPEG or PNG."""
    goal: bytes | None = None
    """The goal image, JPEG or PNG."""
    drive: Path | None = None
    """The mapping drive, which holds both images."""
    recording: Path | None = None
    """Recording of the episode."""
    time_s: float | None = None
    """Moment of the failure in the recording, in seconds after its beginning."""

    @property
    def scene(self) -> str:
        """Name of the scene."""
        return scene_name(setup_of(self.trial).scene)

    @property
    def heading(self) -> str:
        """Method and stage."""
        setup = setup_of(self.trial)
        return f"{setup.method}, {setup.stage}"

    @property
    def cause(self) -> str:
        """Cause of the failure."""
        return self.episode.failure.value if self.episode.failure else "unknown"

    @property
    def beginning(self) -> str | None:
        """The first cause, if it differs from the main one."""
        first = self.episode.trigger
        return None if first is None or first is self.episode.failure else first.value

    @property
    def command(self) -> str | None:
        """The command that shows the moment in the app; None without a recording."""
        if self.recording is None:
            return None
        at = "" if self.time_s is None else f" --at {self.time_s:.1f}"
        return f"ltvn replay {shlex.quote(str(self.recording))}{at} --ask {_QUESTION}"

    @property
    def recording_command(self) -> str | None:
        """The command that records an episode without a recording; None if there is no such command."""
        if self.recording is not None or not self.trial.command.startswith("ltvn evaluate "):
            return None
        failed = [episode.query for episode in self.trial.episodes if not episode.reached]
        made_by = re.sub(r" --record-failures[ =]\d+", "", self.trial.command)
        return f"{made_by} --record-failures {failed.index(self.episode.query) + 1}"


def data_url(image: bytes) -> str:
    """Return a JPEG or PNG image as a data URL. Raises OptionError for anything else."""
    for mark, kind in _MIME_TYPES.items():
        if image.startswith(mark):
            return f"data:{kind};base64,{b64encode(image).decode()}"
    raise OptionError("An image of the failure gallery is neither JPEG nor PNG; encode it as one of them.")


def select_failures(rows: Sequence[FailureRow], most: int) -> tuple[FailureRow, ...]:
    """Return a limited number of rows for each scene, method and stage.

    Rows are taken from each cause in turn, so that every cause is represented. Rows with a recording come first.
    """
    groups = grouped(rows, lambda row: setup_of(row.trial))
    return tuple(row for setup in sorted(groups, key=order_of) for row in _in_turn(groups[setup])[:most])


def _in_turn(rows: Sequence[FailureRow]) -> list[FailureRow]:
    counts: dict[FailureCause | None, int] = {}
    ranked = []
    for row in sorted(rows, key=lambda row: row.recording is None):
        counts[row.episode.failure] = turn = counts.get(row.episode.failure, 0) + 1
        ranked.append((turn, row))
    return [row for _, row in sorted(ranked, key=lambda each: each[0])]
