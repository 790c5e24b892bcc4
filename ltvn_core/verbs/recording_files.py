"""`ltvn info | verify | repair`: describe, check and repair recordings."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class InfoVerb(Verb):
    """Describe a recording or a map."""

    job = "ltvn_core.verbs.jobs.recording_files:tell_info"

    recording: Positional[Path]
    """The .rrd file."""


@dataclass(frozen=True, kw_only=True)
class VerifyVerb(Verb):
    """Check that a recording is complete and undamaged; the exit code is not zero if it is not."""

    job = "ltvn_core.verbs.jobs.recording_files:verify_recording"

    recording: Positional[Path]
    """The .rrd file."""


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
