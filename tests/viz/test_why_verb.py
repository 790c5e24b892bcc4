"""`ltvn why` answers in a terminal, as text and as JSON, and says what can be asked."""

import json
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from tests.program import Answered, ltvn_here
from tests.repository import DEMO_FAULT, DEMO_MAP, ROOT

Why = Callable[..., Answered]


@pytest.fixture
def why(capsys: pytest.CaptureFixture[str]) -> Why:
    """Ask in this process."""
    return partial(ltvn_here, capsys, "why")


def answered(why: Why, file: Path, *arguments: str) -> dict:
    """Ask for JSON."""
    done = why(file, *arguments, "--json", "-")
    assert done.code == 0, done.stderr
    return json.loads(done.stdout)


def test_an_edge_is_told_with_its_attempts() -> None:
    command = [sys.executable, "-m", "ltvn_core.cli", "why", str(DEMO_FAULT), "--edge", "1489", "2621"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8", timeout=300)
    assert done.returncode == 0, done.stderr
    assert "1489 → 2621" in done.stdout
    assert done.stdout.count("failed (blocked)") >= 4


def test_the_same_as_json_says_what_was_asked_and_each_link_is_a_command_that_answers(why: Why) -> None:
    told = answered(why, DEMO_FAULT, "--edge", "1489", "2621", "--at", "5")
    links = [link for block in told["blocks"] if block["kind"] == "text" for link in block["links"]]
    back = next(link["to"] for link in links if "2621 1489" in link["to"])
    _, verb, file, *rest = back.split()
    assert (told["question"], told["at_s"], told["about"]) == ("edge", 5.0, {"edge": [1489, 2621]})
    assert (verb, file) == ("why", str(DEMO_FAULT))
    assert answered(why, Path(file), *rest)["about"] == {"edge": [2621, 1489]}


def test_without_a_question_those_that_the_file_can_answer_are_listed(why: Why) -> None:
    of_run = {each["question"] for each in answered(why, DEMO_FAULT)["questions"]}
    of_map = {each["question"] for each in answered(why, DEMO_MAP)["questions"]}
    assert {"edge", "failures", "truth", "what-if"} <= of_run
    assert "failures" not in of_map
    assert "edge" in of_map


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--ask", "egde"), "Did you mean edge?"),
        (("--ask", "hand"), "these can"),
        (("--edge", "1489", "99999"), "327 nodes"),
        (("--edge", "3", "3"), "two different"),
        (("--edge", "3", "7", "--at", "99"), "26.7 s"),
        (("--query", "9"), "queries 0 to 3"),
        (("--ask", "what-if", "--text", "nonsense"), "without"),
    ],
)
def test_a_refusal_says_what_would_be_valid(why: Why, arguments: tuple[str, ...], said: str) -> None:
    done = why(DEMO_FAULT, *arguments)
    assert done.code == 1
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_query_is_told_alone(why: Why) -> None:
    said = why(DEMO_FAULT, "--query", "1").stdout
    assert "query 1" in said.lower()
    assert not any(f"query {other}" in said.lower() for other in (0, 2, 3))
    assert "of 4" not in said


def test_the_terminal_says_what_to_type_and_never_to_click(why: Why) -> None:
    listed = why(DEMO_FAULT).stdout
    edge, what_if, compare = (why(DEMO_FAULT, "--ask", word).stdout for word in ("edge", "what-if", "compare"))
    assert "click" not in (listed + edge + what_if + compare).lower()
    assert "--edge" in edge
    assert "--text" in what_if
    assert "--text" in compare
    typed = what_if.partition('--text "')[2].partition('"')[0]
    assert "is not in the map" not in why(DEMO_FAULT, "--ask", "what-if", "--text", typed).stdout


def test_an_edge_that_is_gone_is_asked_about_at_the_moment_that_the_answer_names(why: Why) -> None:
    change = ("--ask", "what-if", "--text", "without 1489->2621")
    gone = why(DEMO_FAULT, *change).stdout
    moment = gone.partition("--at ")[2].split()[0].rstrip(".")
    assert "is not in the map" in gone
    assert "is not in the map" not in why(DEMO_FAULT, *change, "--at", moment).stdout


def test_another_map_is_named_by_its_path_to_compare_with(why: Why, tmp_path: Path) -> None:
    other = tmp_path / "elsewhere.rrd"
    other.write_bytes(DEMO_MAP.read_bytes())
    said = why(DEMO_FAULT, "--ask", "compare", "--text", str(other))
    unknown = why(DEMO_FAULT, "--ask", "compare", "--text", str(tmp_path / "nothing.rrd"))
    assert (said.code, "only here" in said.stdout) == (0, True)
    assert (unknown.code, DEMO_MAP.name in unknown.stderr) == (1, True)


def test_nodes_beyond_the_limit_of_a_comparison_are_not_called_missing(
    why: Why, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ltvn_viz.debugger.localisation_question.MAX_NODES", 5)  # A map of 2,001 nodes takes minutes.
    told = answered(why, DEMO_FAULT, "--ask", "where")
    text = " ".join(block.get("text", "") for block in told["blocks"])
    assert "limit" in text
    assert "missing" not in text


def test_the_weights_of_a_fine_tuned_run_can_be_named(why: Why, tmp_path: Path) -> None:
    unreadable = tmp_path / "tuned.safetensors"
    unreadable.write_bytes(b"")
    told = answered(why, DEMO_FAULT, "--ask", "where", "--weights", str(unreadable))
    assert any(unreadable.name in block.get("text", "") for block in told["blocks"])
