"""`ltvn info | verify | repair | view`: describe, check and repair recordings, and open one in the Rerun viewer."""

import logging
from dataclasses import dataclass

from ltvn_core.data.recording.damage.integrity import repair, verify
from ltvn_core.data.recording.info import read_info
from ltvn_core.data.recording.viewer_server import serve_viewer
from ltvn_core.verbs.recording_files import InfoVerb, RepairVerb, VerifyVerb
from ltvn_core.verbs.verb import Summary
from ltvn_core.verbs.view import ViewVerb


def tell_info(options: InfoVerb) -> Summary:
    """Return the summary of the file; raises RecordingError."""
    return read_info(options.recording)


def verify_recording(options: VerifyVerb) -> Summary:
    """Check the file; for a cut or damaged one, raises RecordingError with a reference to `ltvn repair`."""
    return verify(options.recording)


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
