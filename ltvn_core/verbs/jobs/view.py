"""`ltvn view`: open a recording in the Rerun viewer, in the browser."""

import logging
from dataclasses import dataclass

from ltvn_core.recording.viewer_server import serve_viewer
from ltvn_core.verbs.verb import Summary
from ltvn_core.verbs.view import ViewVerb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ViewSummary:
    """Where the viewer was."""

    url: str


def view_recording(options: ViewVerb) -> Summary:
    """Serve until interrupted; raises RecordingError and ServerError."""
    with serve_viewer(options.recording, options.port) as viewer:
        _LOG.info("Open %s (Ctrl-C ends).", viewer.url)
        viewer.wait()
    return ViewSummary(viewer.url)
