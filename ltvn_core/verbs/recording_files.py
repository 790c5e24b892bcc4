"""`ltvn info | verify | repair`: describe, check and repair recordings."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summaries, Summary, Verb


@dataclass(frozen=True, kw_only=True)
class RecordingsVerb(Verb):
    """A verb that reads one or more recordings, each by itself."""

    recordings: Positional[tuple[Path, ...]]
    """The .rrd files. Several give a block of text each, and with --json a list."""

    def exit_code(self, summary: Summary) -> int:
        """Return 1 if one of several files failed."""
        return 1 if isinstance(summary, Summaries) and summary.failed else 0


@dataclass(frozen=True, kw_only=True)
class InfoVerb(RecordingsVerb):
    """Describe recordings or maps; the exit code is not zero if one of them cannot be read."""

    job = "ltvn_core.verbs.jobs.recording_files:tell_info"


@dataclass(frozen=True, kw_only=True)
class VerifyVerb(RecordingsVerb):
    """Check that recordings are complete and undamaged; the exit code is not zero if one of them is not."""

    job = "ltvn_core.verbs.jobs.recording_files:verify_recording"


@dataclass(frozen=True, kw_only=True)
class RepairVerb(Verb):
    """Copy all complete frames and events of a cut, unfinished or damaged recording to a new file."""

    job = "ltvn_core.verbs.jobs.recording_files:repair_recording"

    recording: Positional[Path]
    """The damaged .rrd file; it is not changed."""
    output: NewRecording
    """File for the repaired recording; must not exist yet."""
    recording_id: str = ""
    """Id of the recording to extract from a file with several, as written by `rerun rrd merge`."""
