"""Nothing that a recording, a file's name or a message holds can steer the terminal of who runs a verb."""

import io
import logging
from dataclasses import dataclass

import pytest

from ltvn_core.cli import run_verb
from ltvn_core.errors import RecordingError
from ltvn_core.terminal_text import PlainFormatter, shown_plainly
from ltvn_core.verbs.verb import Verb

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
