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


def test_a_query_is_told_with_what_failed_in_it(why: Why) -> None:
    told = answered(why, DEMO_FAULT, "--query", "3")

    assert told["question"] == "failures"
    assert any("query 3" in block.get("text", "") for block in told["blocks"])


def test_without_a_question_those_that_the_file_can_answer_are_listed(why: Why) -> None:
    of_run = {each["question"] for each in answered(why, DEMO_FAULT)["questions"]}
    of_map = {each["question"] for each in answered(why, DEMO_MAP)["questions"]}

    assert {"edge", "failures", "truth", "what-if"} <= of_run
    assert "failures" not in of_map
    assert "edge" in of_map


def test_what_a_person_would_type_is_taken_as_text(why: Why) -> None:
    told = why(DEMO_FAULT, "--ask", "what-if", "--at", "1", "--text", "without 1489->2621")

    assert "instead of 2 nodes" in told.stdout


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
