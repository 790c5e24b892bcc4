"""A program reads recordings through `ltvn mcp`: files by name, answers with what to ask next, and pictures.

A script without any model finds the faults that were planted in a map, in a few calls.
"""

import base64
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

from ltvn_core.data.recording.reader import Recording
from ltvn_viz.agent.tools import LARGEST_IMAGE
from tests.platforms import needs_posix
from tests.repository import DEMO_DRIVE, DEMO_FAULT, DEMO_MAP, ROOT
from tests.viz.agent.agent_client import AgentClient, agent_client
from tests.waiting import PATIENCE_S

FAULT = DEMO_FAULT.name


@pytest.fixture(scope="module")
def agent() -> Iterator[AgentClient]:
    """A program that may read two of the demo recordings."""
    with agent_client(DEMO_FAULT, DEMO_MAP) as connected:
        yield connected


def test_all_tools_say_that_they_only_read_and_what_they_take(agent: AgentClient) -> None:
    tools = agent.tools()
    assert {tool.name for tool in tools} == {"list_files", "describe", "timeline", "ask", "image", "map_picture"}
    assert all(tool.annotations is not None and tool.annotations.read_only_hint for tool in tools)
    assert all(tool.description and tool.input_schema["additionalProperties"] is False for tool in tools)


def test_a_recording_is_described_with_its_queries_and_questions(agent: AgentClient) -> None:
    told = agent.ask("describe", file=FAULT)
    assert [query["succeeded"] for query in told["queries"]] == [False] * 4
    assert told["map_at_end"]["nodes"] == 327
    assert {"edge", "failures", "what-if"} <= told["questions"].keys()
    assert "hand" not in told["questions"]


def test_the_planted_faults_are_not_told_by_the_description(agent: AgentClient) -> None:
    assert "spurious" not in str(agent.ask("describe", file=FAULT)).replace("edges that cannot be driven", "")


def test_a_stretch_of_time_is_told_by_kind_and_in_bounds(agent: AgentClient) -> None:
    failures = agent.ask("timeline", file=FAULT, kinds=["failure"], to_s=8.0, most=2)
    assert [row["about"] for row in failures["rows"]] == [[1489, 2621]] * 2
    assert failures["left_out"] > 0


def test_an_answer_says_what_to_ask_next_and_following_it_answers(agent: AgentClient) -> None:
    answer = agent.ask("ask", file=FAULT, edge=[1489, 2621])
    follow = next(each["ask"] for each in answer["follow"] if each["ask"].get("edge") == [2621, 1489])
    assert "2621 → 1489" in agent.ask("ask", file=FAULT, **follow)["text"]


def test_a_slow_answer_is_waited_for_and_nothing_is_remembered_from_one_call_to_the_next(agent: AgentClient) -> None:
    answer = agent.ask("ask", file=FAULT, question="what-if", text="without 1489->2621", at_s=1.0)
    afterwards = agent.ask("ask", file=FAULT, question="what-if", text="goal 3", at_s=1.0)
    assert "instead of 2 nodes" in answer["text"]
    assert "without 1489" not in afterwards["text"]


def test_images_and_maps_are_pictures_of_bounded_size(agent: AgentClient) -> None:
    seen = agent.picture("image", file=FAULT, frame=1489)
    drawn = agent.picture("map_picture", file=FAULT, at_s=0.0)
    assert (seen.mime_type, drawn.mime_type) == ("image/jpeg", "image/png")
    assert max(Image.open(io.BytesIO(base64.b64decode(seen.data))).size) <= LARGEST_IMAGE
    assert max(Image.open(io.BytesIO(base64.b64decode(drawn.data))).size) <= 1100


@pytest.mark.parametrize("name", [DEMO_DRIVE.name, str(DEMO_DRIVE), f"../recordings/{FAULT}", "/etc/passwd"])
def test_only_the_named_files_can_be_read(agent: AgentClient, name: str) -> None:
    assert FAULT in agent.refusal("describe", file=name)
    assert agent.call("ask", {"file": FAULT, "question": "compare", "text": name}).is_error


@pytest.mark.parametrize(
    ("tool", "arguments", "said"),
    [
        ("describe", {}, "file is missing"),
        ("ask", {"file": FAULT, "edge": [1489]}, "two nodes"),
        ("ask", {"file": FAULT, "question": "egde"}, "Did you mean edge?"),
        ("ask", {"file": FAULT, "nod": 3}, "Did you mean node?"),
        ("timeline", {"file": FAULT, "kinds": ["crash"]}, "collision"),
        ("timeline", {"file": FAULT, "kinds": ["seen open"]}, "prune"),
        ("timeline", {"file": FAULT, "most": 10**9}, "from 1 to 500"),
        ("image", {"file": FAULT, "frame": 5}, "no image of frame 5"),
        ("delete", {}, "no tool"),
    ],
)
def test_a_refusal_says_what_would_be_valid(agent: AgentClient, tool: str, arguments: dict, said: str) -> None:
    assert said in agent.refusal(tool, **arguments)


@needs_posix
def test_whatever_a_folder_holds_and_a_program_sends_is_answered(tmp_path: Path) -> None:
    os.link(DEMO_MAP, os.fsencode(tmp_path) + b"/caf\xe9.rrd")
    os.link(DEMO_MAP, tmp_path / DEMO_MAP.name)
    (tmp_path / "cut.rrd").write_bytes(DEMO_FAULT.read_bytes()[:100_000])
    hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "a", "version": "1"}}
    lines: list[dict] = [
        {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello},
        {"jsonrpc": "2.0", "method": "notifications/initialized"},
    ]
    for number, file in enumerate((r"caf\xe9.rrd", "cut.rrd", "\ud800", DEMO_MAP.name), 2):  # One is half a character.
        asked = {"name": "describe", "arguments": {"file": file}}
        lines.append({"jsonrpc": "2.0", "id": number, "method": "tools/call", "params": asked})
    program = [sys.executable, "-m", "ltvn_core.cli", "mcp", str(tmp_path)]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT, text=True) as agent:
        assert agent.stdin is not None
        assert agent.stdout is not None
        agent.stdin.write("".join(json.dumps(line) + "\n" for line in lines) + "{no message\n")
        agent.stdin.flush()
        answers = {answer["id"]: answer for answer in (json.loads(agent.stdout.readline()) for _ in range(6))}
        agent.stdin.close()
        assert agent.wait(PATIENCE_S) == 0
    assert "error" in answers.pop(None)
    told = [
        (answers[number]["result"]["isError"], answers[number]["result"]["content"][0]["text"])
        for number in range(2, 6)
    ]
    assert [refused for refused, _ in told] == [True, True, True, False]
    assert "UTF-8" in told[0][1]
    assert all(name in told[2][1] for name in ("cut.rrd", DEMO_MAP.name, "xe9.rrd"))
    assert json.loads(told[3][1])["map_at_end"]["nodes"] == 327


PLANTED = Recording.open(DEMO_FAULT).meta.config["faults"]
MOST_CALLS = 12


@pytest.mark.parametrize("planted", PLANTED, ids=lambda planted: f"{planted['query']} {planted['kind']}")
def test_what_a_failed_query_tells_leads_to_its_fault_in_a_few_calls(agent: AgentClient, planted: dict) -> None:
    before = agent.calls
    kind, edges = find_fault(agent, planted["query"])
    assert kind == planted["kind"]
    assert any(edge in planted["edges"] for edge in edges)
    assert agent.calls - before <= MOST_CALLS


def find_fault(agent: AgentClient, number: int) -> tuple[str, list[list[int]]]:
    """Return the kind of the fault that made a query fail, and the edges that it may be, found without its truth.

    The answer about the query names the edge that it failed at, the edges that odometry contradicts, and where the map
    has a gap before the goal. An edge that closes the gap must lead to a plan.
    """
    query = agent.ask("describe", file=FAULT)["queries"][number]
    told = agent.ask("ask", file=FAULT, query=number)["text"]
    if query["outcome"] != "no path":
        driven = edges_in(told, r"It drove edge (\d+) → (\d+)")
        return "look-alike" if driven[0] in edges_in(told, r"two places .* (\d+) → (\d+)$") else "spurious-edge", driven
    closing = []
    for edge in edges_in(told.partition("nearest across it")[2], r"(\d+) → (\d+) \("):
        asked = {"question": "what-if", "at_s": query["end_s"], "text": f"with {edge[0]}->{edge[1]}"}
        if "instead of no way" in agent.ask("ask", file=FAULT, **asked)["text"]:
            closing.append(edge)
    return "missing-edge", closing


def edges_in(text: str, pattern: str) -> list[list[int]]:
    return [[*map(int, found)] for found in re.findall(pattern, text, re.MULTILINE)]
