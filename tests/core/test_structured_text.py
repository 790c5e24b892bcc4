"""JSON and TOML of strangers become values, or are refused by an error that every reader expects."""

import io
import logging
import sys
from dataclasses import dataclass

import pytest

from ltvn_core.cli import run_verb
from ltvn_core.errors import RecordingError
from ltvn_core.structured_text import parse_json, parse_toml
from ltvn_core.terminal_text import PlainFormatter, shown_plainly
from ltvn_core.verbs.verb import Verb


@pytest.mark.parametrize("levels", [150, 900, 5 * sys.getrecursionlimit(), 200_000])
def test_a_text_of_too_many_levels_is_a_wrong_value_and_nothing_worse(levels: int) -> None:
    lists = "[" * levels + "]" * levels
    objects = '{"a":' * levels + "1" + "}" * levels
    for text in (lists, objects, lists.encode()):
        with pytest.raises(ValueError, match="deep"):
            parse_json(text)
    with pytest.raises(ValueError, match="deep"):
        parse_toml(f"a = {lists}")


def test_names_with_many_dots_are_as_deep_as_tables() -> None:
    with pytest.raises(ValueError, match="deep"):
        parse_toml(f"{'a.' * 500}a = 1")


def test_a_long_toml_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(ValueError, match="characters"):
        parse_toml("# all is well\n" * 100_000)


def test_what_people_write_comes_out_as_written() -> None:
    assert parse_json('{"a": [1, {"b": null}], "c": "]]]"}') == {"a": [1, {"b": None}], "c": "]]]"}
    assert parse_json(b"[" * 50 + b"7" + b"]" * 50)
    assert parse_toml("[robot]\nname = 'x'\nsizes = [1, 2]") == {"robot": {"name": "x", "sizes": [1, 2]}}


def test_half_a_surrogate_pair_is_replaced_wherever_it_stands_and_whole_pairs_stay() -> None:
    text = r'{"\ud800": ["\udce4", {"a": "\ud83d\ude00\ude00"}], "b": 0.1}'
    for given in (text, text.encode()):
        assert parse_json(given) == {"\ufffd": [r"\xe4", {"a": "\U0001f600\ufffd"}], "b": 0.1}


HOSTILE = "demo\x1b]0;OWNED\x07\x1b[2J\x9b31m\rall is well\u202e\x7f"


@dataclass(frozen=True)
class SceneSummary:
    scene: str
    more: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class SceneVerb(Verb):
    """Tell a scene."""

    fail: bool = False

    def run(self) -> SceneSummary:
        if self.fail:
            raise RecordingError(f"{HOSTILE} is no recording.")
        return SceneSummary(HOSTILE, (HOSTILE * 5, "plain"))


def steering(text: str) -> set[str]:
    return {each for each in text if (ord(each) < 32 and each != "\n") or 127 <= ord(each) < 160 or each == "\u202e"}


@pytest.mark.parametrize("options", [[], ["--json", "-"], ["--fail"], ["--fail", "--debug"]])
def test_what_a_verb_prints_of_a_recording_steers_no_terminal(
    options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_verb("scene", SceneVerb, options) == ("--fail" in options)
    shown = capsys.readouterr()
    assert "OWNED" in shown.out + shown.err
    assert not steering(shown.out + shown.err)


def test_a_log_steers_no_terminal() -> None:
    written = io.StringIO()
    handler = logging.StreamHandler(written)
    handler.setFormatter(PlainFormatter("%(message)s"))
    handler.emit(logging.LogRecord("x", logging.WARNING, "", 0, "kept %s", (HOSTILE,), None))
    assert "OWNED" in written.getvalue()
    assert not steering(written.getvalue())


def test_names_of_every_language_are_shown_as_they_are() -> None:
    text = "Küche, 台所, مطبخ: p 0.5 ± 0.1 → node 7\n\tas it is"
    assert shown_plainly(text) == text
