"""Calls of tools that a careless or hostile program might send, sensible and not, and the judge of what came back."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

from mcp.types import CallToolResult, TextContent

from tests.repository import RECORDINGS
from tests.viz.agent.agent_client import AgentClient, agent_client

FILES = ("demo-fault.rrd", "demo-map.rrd")
_TOOLS = ("list_files", "describe", "timeline", "ask", "image", "map_picture", "delete", "", "ask\x00")
_NAMES = (
    *("file", "at_s", "from_s", "to_s", "kinds", "most", "question", "edge", "node", "query", "text", "frame"),
    *("path", "__class__", "self", "longest_s", ""),
)
_TAKEN: dict[str, tuple[str, ...]] = {
    "describe": (),
    "timeline": ("from_s", "to_s", "kinds", "most"),
    "ask": ("question", "at_s", "edge", "node", "query", "text"),
    "image": ("frame",),
    "map_picture": ("at_s",),
}
"""What the tools take beside the file."""
_WORDS = (
    *("edge", "blame", "time", "what-if", "where", "break"),
    *("compare", "truth", "failures", "share", "hand", "coach"),
)
_TEXTS = (
    *("without 1489->2621", "goal 3", "all", "Take the lift", "remove all", "save this moment", "demo-map.rrd"),
    *("1 h ago", "../demo-drive.rrd", "/etc/passwd", "D_c = 1e308", "forget all", "\x1b[2J", "x" * 300),
    "\ud800".encode("utf-8", "replace").decode(),
)
_ODD: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, -1e-9, 2**70),
    *("", "NaN", [], {}, [[]], {"a": [1]}, "../../etc", [1, 2, 3]),
)
LONGEST_RESULT = 2_000_000
"""Letters of the largest answer, a picture of the map."""


@contextmanager
def harmless_agent(folder: Path) -> Iterator[AgentClient]:
    """Serve copies of two recordings, and require that whatever is called changes no answer and writes no file."""
    for name in FILES:
        shutil.copyfile(RECORDINGS / name, folder / name)
    before = _everything_in(folder)
    # Home, temporary files and working folder are where the recordings are, so that whatever is written is seen.
    with agent_client(folder, cwd=folder, HOME=str(folder), TMPDIR=str(folder)) as agent:
        said = _known_answers(agent)
        yield agent
        assert _known_answers(agent) == said
    assert _everything_in(folder) == before


def _known_answers(agent: AgentClient) -> list[dict[str, Any]]:
    described = [agent.ask("describe", file=name) for name in FILES]
    return [agent.ask("list_files"), *described, agent.ask("ask", file=FILES[0], question="failures")]


def _everything_in(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return all files below a folder with their times and contents."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


def draw_call(random: Random) -> tuple[str, dict[str, Any]]:
    """Return a tool and its arguments; about half of the calls make sense."""
    tool = random.choice(_TOOLS if random.random() < 0.5 else ("ask",))
    arguments: dict[str, Any] = {"file": random.choice(FILES)} if tool != "list_files" else {}
    taken = _TAKEN.get(tool, ())
    for name in random.sample(taken, random.randint(0, min(3, len(taken)))):
        arguments[name] = _value(name, random)
    if random.random() < 0.15:
        arguments[random.choice(_NAMES)] = random.choice(_ODD)
    return tool, arguments


def _value(name: str, random: Random) -> Any:
    if random.random() < 0.15:
        return random.choice(_ODD)
    nodes = (3, 7, 18, 1489, 2621, 1158, 2465, 9999)
    match name:
        case "at_s" | "from_s" | "to_s":
            return random.choice((0, 1.6, 8.0, 20.5, 26.7, 1e6))
        case "kinds":
            return random.sample(("failure", "prune", "query end", "nonsense"), 2)
        case "edge":
            return [random.choice(nodes), random.choice(nodes)]
        case "node" | "frame" | "query" | "most":
            return random.choice((*nodes, 0, 1, 2))
        case "question":
            return random.choice(_WORDS)
        case _:
            return random.choice(_TEXTS)


def judge_call(agent: AgentClient, random: Random) -> str:
    """Make a call and return what is wrong with what came back, empty if nothing."""
    tool, arguments = draw_call(random)
    return _complaint(f"{tool} {json.dumps(arguments)[:300]}", agent.call(tool, arguments))


def _complaint(asked: str, result: CallToolResult) -> str:
    (content,) = result.content
    said = content.text if isinstance(content, TextContent) else getattr(content, "data", "")
    if len(said) > LONGEST_RESULT:
        return f"{asked}: {len(said)} letters"
    if result.is_error and ("could not be answered" in said or "Traceback" in said or not said):
        return f"{asked}: {said}"
    return ""
