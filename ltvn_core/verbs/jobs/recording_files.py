"""`ltvn info | verify | repair | view`: describe, check and repair recordings, and open one in the Rerun viewer."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.integrity import repair, verify
from ltvn_core.data.recording.viewer_server import serve_viewer
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.verbs.recording_files import InfoVerb, RecordingsVerb, RepairVerb, VerifyVerb
from ltvn_core.verbs.verb import Summaries, Summary, Unreadable
from ltvn_core.verbs.view import ViewVerb


def tell_info(options: InfoVerb) -> Summary:
    """Return the summary of the files; of a single one, raises RecordingError."""
    return _of_each(options, read_info)


def verify_recording(options: VerifyVerb) -> Summary:
    """Check the files; for a single cut or damaged one, raises RecordingError with a reference to `ltvn repair`."""
    return _of_each(options, verify)


def _of_each(options: RecordingsVerb, read: Callable[[Path], Summary]) -> Summary:
    """Return the summary of the one file, or those of all of them, in which errors have their place."""
    if not options.recordings:
        raise OptionError("Name at least one recording, such as drive.rrd.")
    if len(options.recordings) == 1:
        return read(options.recordings[0])
    return Summaries(tuple(_summary_or_failure(path, read) for path in options.recordings))


def _summary_or_failure(path: Path, read: Callable[[Path], Summary]) -> Summary:
    try:
        return read(path)
    except (LtvnError, OSError) as error:
        return Unreadable(path, str(error))


def repair_recording(options: RepairVerb) -> Summary:
    """Repair the file; raises RecordingError where nothing can be saved."""
    return repair(options.recording, options.output, recording_id=options.recording_id or None)


_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ViewSummary:
    """Address of the viewer."""

    url: str


def view_recording(options: ViewVerb) -> Summary:
    """Serve until interrupted; raises RecordingError and ServerError."""
    with serve_viewer(options.recording, options.port) as viewer:
        _LOG.info("Open %s (Ctrl-C ends).", viewer.url)
        viewer.wait()
    return ViewSummary(viewer.url)
