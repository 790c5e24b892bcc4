"""`ltvn mcp`: answers questions of language-model programs about recordings, over the Model Context Protocol."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from ltvn_core.verbs.verb import OwnWords, Verb


@dataclass(frozen=True)
class AgentSummary(OwnWords):
    """Numbers of calls."""

    calls: int
    refused: int
    """Number of invalid calls."""

    def as_text(self) -> str:
        """Return an empty text, because standard output belongs to the protocol."""
        return ""

    def as_json(self) -> dict[str, Any]:
        """Return the counts."""
        return {"calls": self.calls, "refused": self.refused}


@dataclass(frozen=True, kw_only=True)
class McpVerb(Verb):
    """Let an AI agent ask about recordings and maps (Model Context Protocol, on standard input and output). It can read
    only the named files."""

    files: Positional[tuple[Path, ...]] = (Path("recordings"),)
    """Recordings (.rrd files), and folders of recordings, that may be read."""

    def run(self) -> AgentSummary:
        """Answer until the program closes the connection; raises OptionError."""
        from ltvn_viz.agent.named_files import NamedFiles
        from ltvn_viz.agent.server import serve
        from ltvn_viz.agent.tools import RecordingTools

        tools = RecordingTools(NamedFiles(self.files))
        serve(tools)
        return AgentSummary(tools.calls, tools.refused)
