"""A program that asks `ltvn mcp` over standard input and output, by the SDK's own client. Owns no assertion."""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anyio.from_thread import BlockingPortal, start_blocking_portal
from mcp import Client, StdioServerParameters
from mcp.types import CallToolResult, ImageContent, TextContent, Tool

from tests.repository import ROOT


@dataclass
class AgentClient:
    """A connection, and how often it was used."""

    portal: BlockingPortal
    client: Client
    calls: int = 0

    def tools(self) -> list[Tool]:
        """Return what is offered."""
        return self.portal.call(self.client.list_tools).tools

    def call(self, name: str, arguments: Mapping[str, Any]) -> CallToolResult:
        """Call a tool with whatever arguments."""
        self.calls += 1
        return self.portal.call(self.client.call_tool, name, dict(arguments))

    def ask(self, name: str, **arguments: Any) -> dict[str, Any]:
        """Call a tool that answers with data."""
        result = self.call(name, arguments)
        assert not result.is_error, text_of(result)
        return json.loads(text_of(result))

    def refusal(self, name: str, **arguments: Any) -> str:
        """Call a tool that is to refuse, and return why it does."""
        result = self.call(name, arguments)
        assert result.is_error
        return text_of(result)

    def picture(self, name: str, **arguments: Any) -> ImageContent:
        """Call a tool that answers with a picture."""
        (content,) = self.call(name, arguments).content
        assert isinstance(content, ImageContent), content
        return content


def text_of(result: CallToolResult) -> str:
    """Return the text of an answer."""
    (content,) = result.content
    assert isinstance(content, TextContent)
    return content.text


@contextmanager
def agent_client(*files: Path, cwd: Path = ROOT, **variables: str) -> Iterator[AgentClient]:
    """Start `ltvn mcp` on some files, and connect to it."""
    python_path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    server = StdioServerParameters(
        command=sys.executable,
        args=["-m", "ltvn_core.cli", "mcp", *map(str, files)],
        env={**os.environ, "PYTHONPATH": python_path, **variables},
        cwd=cwd,
    )
    with start_blocking_portal() as portal, portal.wrap_async_context_manager(Client(server)) as client:
        yield AgentClient(portal, client)
