"""`ltvn mcp`: answers questions of language-model programs about recordings, over the Model Context Protocol."""

from dataclasses import dataclass
from typing import Any

from ltvn_core.verbs.verb import OwnWords, Summary
from ltvn_viz.agent.named_files import NamedFiles
from ltvn_viz.agent.server import serve
from ltvn_viz.agent.tools import RecordingTools
from ltvn_viz.verbs.mcp import McpVerb


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


def serve_agent(options: McpVerb) -> Summary:
    """Answer until the program closes the connection; raises OptionError."""
    tools = RecordingTools(NamedFiles(options.files))
    serve(tools)
    return AgentSummary(tools.calls, tools.refused)
