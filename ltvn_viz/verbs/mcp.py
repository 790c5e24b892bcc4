"""`ltvn mcp`: answers questions of language-model programs about recordings, over the Model Context Protocol."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class McpVerb(Verb):
    """Let an AI agent ask about recordings and maps (Model Context Protocol, on standard input and output). It can read
    only the named files."""

    job = "ltvn_viz.verbs.jobs.mcp:serve_agent"

    files: Positional[tuple[Path, ...]] = (Path("recordings"),)
    """Recordings (.rrd files), and folders of recordings, that may be read."""
