"""Serves the tools to programs by the Model Context Protocol (MCP), over standard input and output.

Owns the protocol; no other module imports the library `mcp`. Tool calls run one after another in a separate thread, so
that the server can read new messages during a call.
"""

import base64
import json
from collections.abc import AsyncIterable, Awaitable, Callable
from importlib.metadata import version
from typing import Any

import anyio
from anyio.streams.memory import MemoryObjectSendStream
from anyio.to_thread import run_sync
from mcp import types
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server
from mcp.shared.message import SessionMessage
from pydantic import ValidationError

from ltvn_core.structured_text import parse_json, readable_value
from ltvn_viz.agent.arguments import object_schema
from ltvn_viz.agent.tools import RecordingTools, Tool, ToolError, ToolImage, ToolResult

_INSTRUCTIONS = (
    "Recordings and maps of robots that navigate by images, and answers of a debugger about them. Begin with "
    "list_files and describe; then ask `failures`, and use the arguments under `follow` for the next question. All "
    "tools only read."
)
_READ_ONLY = types.ToolAnnotations(
    read_only_hint=True, destructive_hint=False, idempotent_hint=True, open_world_hint=False
)


def serve(tools: RecordingTools) -> None:
    """Answer one program, until it closes the connection."""
    anyio.run(_serve, tools)


async def _serve(tools: RecordingTools) -> None:
    server = agent_server(tools)
    async with stdio_server() as (read, write), anyio.create_task_group() as tasks:
        told, heard = anyio.create_memory_object_stream[SessionMessage | Exception]()
        tasks.start_soon(_relay, read, told, write.send)
        await server.run(heard, write, server.create_initialization_options())


async def _relay(
    read: AsyncIterable[SessionMessage | Exception],
    told: MemoryObjectSendStream[SessionMessage | Exception],
    answer: Callable[[SessionMessage], Awaitable[None]],
) -> None:
    """Pass messages on; the library would leave those that it cannot read without an answer."""
    async with told:
        async for heard in read:
            message = _read_again(heard) if isinstance(heard, ValidationError) else heard
            if isinstance(message, types.JSONRPCError):
                await answer(SessionMessage(message))
            else:
                await told.send(message)


def _read_again(refused: ValidationError) -> SessionMessage | types.JSONRPCError:
    """Read a message with unreadable text, such as half of a surrogate pair; return a refusal if it is no message."""
    request = None
    try:
        fields = parse_json(str(refused.errors()[0]["input"]))
        request = fields.get("id")
        return SessionMessage(types.jsonrpc_message_adapter.validate_python(fields, by_name=False))
    except (ValueError, AttributeError):
        told = types.ErrorData(
            code=types.INVALID_REQUEST, message="This is not a JSON-RPC request in one line of UTF-8."
        )
        return types.JSONRPCError(jsonrpc="2.0", id=request if isinstance(request, int | str) else None, error=told)


def agent_server(tools: RecordingTools) -> Server[Any]:
    """Return a server that offers the tools."""
    one_at_a_time = anyio.CapacityLimiter(1)

    async def list_tools(_: object, __: types.PaginatedRequestParams | None) -> types.ListToolsResult:
        return types.ListToolsResult(tools=[_described(tool) for tool in tools.tools.values()])

    async def call_tool(_: object, asked: types.CallToolRequestParams) -> types.CallToolResult:
        result = await run_sync(tools.call, asked.name, asked.arguments or {}, limiter=one_at_a_time)
        return _packed(result)

    return Server(
        "ltvn",
        version=version("ltvn"),
        instructions=_INSTRUCTIONS,
        on_list_tools=list_tools,
        on_call_tool=call_tool,
    )


def _described(tool: Tool) -> types.Tool:
    return types.Tool(
        name=tool.name,
        description=tool.about,
        input_schema=object_schema(tool.parameters),
        annotations=_READ_ONLY,
    )


def _packed(result: ToolResult) -> types.CallToolResult:
    match result:
        case ToolError(text=text):
            return types.CallToolResult(content=[types.TextContent(text=text)], is_error=True)
        case ToolImage(data=data, mime_type=mime_type):
            image = types.ImageContent(data=base64.b64encode(data).decode("ascii"), mime_type=mime_type)
            return types.CallToolResult(content=[image])
        case _:
            told = readable_value(result)
            text = types.TextContent(text=json.dumps(told, ensure_ascii=False))
            return types.CallToolResult(content=[text], structured_content=told)
