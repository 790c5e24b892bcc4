"""`ltvn view`: open a recording in the Rerun viewer, in the browser."""

import logging
from dataclasses import dataclass

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class ViewSummary:
    """Where the viewer was."""

    url: str


@dataclass(frozen=True, kw_only=True)
class ViewVerb(Verb):
    """Open a recording in the Rerun web viewer, served to this machine only."""

    recording: Positional[str]
    """The .rrd file, or the address that a run with --stream says."""
    port: int = 9090
    """Port on 127.0.0.1; 0 takes a free one."""

    def run(self) -> Summary:
        """Serve until interrupted; raises RecordingError and ServerError."""
        from ltvn_core.recording.viewer_server import serve_viewer

        with serve_viewer(self.recording, self.port) as viewer:
            _LOG.info("Open %s (Ctrl-C ends).", viewer.url)
            viewer.wait()
        return ViewSummary(viewer.url)
