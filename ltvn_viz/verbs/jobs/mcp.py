"""`ltvn mcp`: programs that work by a language model ask about recordings, by the Model Context Protocol."""

from dataclasses import dataclass
from typing import Any

from ltvn_core.verbs.verb import OwnWords, Summary
from ltvn_viz.agent.named_files import NamedFiles
from ltvn_viz.agent.server import serve
from ltvn_viz.agent.tools import RecordingTools
from ltvn_viz.verbs.mcp import McpVerb


@dataclass(frozen=True)
class AgentSummary(OwnWords):
    """How much was asked."""

    calls: int
    refused: int
    """Calls that made no sense."""

    def as_text(self) -> str:
        """Return nothing: standard output belongs to the program that asked."""
        return ""

    def as_json(self) -> dict[str, Any]:
        """Return the counts."""
        return {"calls": self.calls, "refused": self.refused}


def serve_agent(options: McpVerb) -> Summary:
    """Answer until the program closes the connection; raises OptionError."""
    tools = RecordingTools(NamedFiles(options.files))
    serve(tools)
    return AgentSummary(tools.calls, tools.refused)
