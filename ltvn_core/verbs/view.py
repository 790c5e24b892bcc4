"""`ltvn view`: open a recording in the Rerun viewer, in the browser."""

from dataclasses import dataclass

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ViewVerb(Verb):
    """Open a recording in the Rerun web viewer, served to this machine only."""

    job = "ltvn_core.verbs.jobs.recording_files:view_recording"

    recording: Positional[str]
    """The .rrd file, or the address that a run with --stream prints."""
    port: int = 9090
    """Port on 127.0.0.1; 0 chooses a free one."""
