"""`ltvn info | verify | repair`: look after recordings."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class InfoVerb(Verb):
    """Say what a recording or a map holds."""

    recording: Positional[Path]
    """The .rrd file."""

    def run(self) -> Summary:
        """Read the file's summary; raises RecordingError."""
        from ltvn_core.recording.info import read_info

        return read_info(self.recording)


@dataclass(frozen=True, kw_only=True)
class VerifyVerb(Verb):
    """Check that a recording is whole and finished; exits non-zero where it is not."""

    recording: Positional[Path]
    """The .rrd file."""

    def run(self) -> Summary:
        """Check the file; raises RecordingError that names `ltvn repair` for a cut or damaged one."""
        from ltvn_core.recording.damage.integrity import verify

        return verify(self.recording)


@dataclass(frozen=True, kw_only=True)
class RepairVerb(Verb):
    """Give back all whole frames and events of a cut, unfinished or damaged recording, in a new file."""

    recording: Positional[Path]
    """The damaged .rrd file; it is left as it is."""
    output: Path
    """Where to write the repaired recording; must not exist yet."""
    recording_id: str = ""
    """Which recording to take out of a file with several, as `rerun rrd merge` makes it."""

    def run(self) -> Summary:
        """Repair the file; raises RecordingError where nothing can be saved."""
        from ltvn_core.recording.damage.integrity import repair

        return repair(self.recording, self.output, recording_id=self.recording_id or None)
