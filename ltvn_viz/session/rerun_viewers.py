"""Recordings opened in Rerun's web viewer from the page.

Owns which are served and that all are closed with the app. The viewer is `ltvn_core.recording.viewer_server`.
"""

from contextlib import ExitStack
from pathlib import Path

from ltvn_core.errors import ServerError


class RerunViewers:
    """Web viewers, one per recording, on free ports of this machine."""

    def __init__(self, stack: ExitStack) -> None:
        """Let `stack` close them."""
        self._stack = stack
        self._addresses: dict[Path, str] = {}

    def address(self, recording: Path) -> str:
        """Return where a recording is shown, and begin to serve it the first time. Raises RecordingError, ServerError.

        Runs in one thread; the very first time takes seconds, because the viewer is unpacked.
        """
        if recording not in self._addresses:
            from ltvn_core.recording.viewer_server import serve_viewer

            self._addresses[recording] = self._stack.enter_context(serve_viewer(recording)).url
        return self._addresses[recording]


def rerun_unavailable(recording: Path) -> str:
    """Refuse, where nobody could close the viewer again."""
    raise ServerError(f"This page cannot open Rerun; run `ltvn view {recording}`.")
