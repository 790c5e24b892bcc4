"""`ltvn info | verify | repair | view`: describe, check and repair recordings, and open one in the Rerun viewer."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.verbs.outputs import NewRecording
from ltvn_core.verbs.verb import Summaries, Summary, Unreadable, Verb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ViewSummary:
    """Address of the viewer."""

    url: str


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

    def run(self) -> Summary:
        """Return the summary of the files; of a single one, raises RecordingError."""
        from ltvn_core.data.recording.info import read_info

        return _of_each(self, read_info)


@dataclass(frozen=True, kw_only=True)
class VerifyVerb(RecordingsVerb):
    """Check that recordings are complete and undamaged; the exit code is not zero if one of them is not."""

    def run(self) -> Summary:
        """Check the files; for a single cut or damaged one, raises RecordingError with a reference to `ltvn repair`."""
        from ltvn_core.data.recording.integrity import verify

        return _of_each(self, verify)


@dataclass(frozen=True, kw_only=True)
class RepairVerb(Verb):
    """Copy all complete frames and events of a cut, unfinished or damaged recording to a new file."""

    recording: Positional[Path]
    """The damaged .rrd file; it is not changed."""
    output: NewRecording
    """File for the repaired recording; must not exist yet."""
    recording_id: str = ""
    """Id of the recording to extract from a file with several, as written by `rerun rrd merge`."""

    def run(self) -> Summary:
        """Repair the file; raises RecordingError where nothing can be saved."""
        from ltvn_core.data.recording.integrity import repair

        return repair(self.recording, self.output, recording_id=self.recording_id or None)


@dataclass(frozen=True, kw_only=True)
class ViewVerb(Verb):
    """Open a recording in the Rerun web viewer, served to this machine only."""

    recording: Positional[str]
    """The .rrd file, or the address that a run with --stream prints."""
    port: int = 9090
    """Port on 127.0.0.1; 0 chooses a free one."""

    def run(self) -> Summary:
        """Serve until interrupted; raises RecordingError and ServerError."""
        from ltvn_core.data.recording.viewer_server import serve_viewer

        with serve_viewer(self.recording, self.port) as viewer:
            _LOG.info("Open %s (Ctrl-C ends).", viewer.url)
            viewer.wait()
        return ViewSummary(viewer.url)


def _of_each(options: RecordingsVerb, read: Callable[[Path], Summary]) -> Summary:
    """Return the summary of the one file, or those of all of them, in which errors have their place."""
    if not options.recordings:
        raise OptionError("Name at least one recording, such as drive.rrd.")
    if len(options.recordings) == 1:
        return read(options.recordings[0])
    summaries: list[Summary] = []
    for path in options.recordings:
        try:
            summaries.append(read(path))
        except (LtvnError, OSError) as error:
            summaries.append(Unreadable(path, str(error)))
    return Summaries(tuple(summaries))
