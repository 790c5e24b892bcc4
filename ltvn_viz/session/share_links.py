"""Links that show another person the same: a recording, a time in it, and a question about a node or an edge.

Owns the format of the address, for writing and reading. Addresses are untrusted: names are looked up in lists, numbers
are checked, and everything else is ignored.
"""

import math
import re
from collections.abc import Mapping
from urllib.parse import parse_qs, urlencode

from ltvn_core.errors import OptionError
from ltvn_viz.server.requests import LINK_PARAMETERS
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.wishes.commands import Ask, Command, OpenRecording, PointAt
from ltvn_viz.wishes.wish_table import Action

_NODE = re.compile(r"[0-9]{1,12}", re.ASCII)
_MAX_FIELDS = 32
QUESTION_WORDS: Mapping[str, str] = {
    word: name.value for name in QuestionName for word in (name.word, *name.earlier_words)
}
"""Names of our own questions, by their words in addresses."""


def link(
    replay: str,
    at_s: float,
    question: QuestionName = QuestionName.FIRST,
    selection: Selection | None = None,
) -> str:
    """Return the address, without host and key, of a recording at a time in seconds after its beginning."""
    words = {"replay": replay, "at": f"{at_s:.2f}".rstrip("0").rstrip(".")}
    if selection is not None and selection.edge is not None:
        words["edge"] = f"{selection.edge[0]}-{selection.edge[1]}"
    elif selection is not None and selection.node is not None:
        words["node"] = str(selection.node)
    if question is not QuestionName.FIRST:
        words["tool"] = question.word
    return f"/?{urlencode(words)}"


def commands_from_link(query: str, questions: Mapping[str, str] = QUESTION_WORDS) -> tuple[Command, ...]:
    """Return the commands in the query of an address, none if it has none. Raises OptionError.

    `questions` maps words to names of questions.
    """
    try:
        fields = parse_qs(query.removeprefix("?"), max_num_fields=_MAX_FIELDS)
    except ValueError as error:
        raise OptionError(f"This link cannot be read ({error}). Ask for it again under “Show somebody”.") from error
    words = {name: fields[name][-1] for name in LINK_PARAMETERS if name in fields}
    shown: tuple[Command, ...] = (*question_commands(words.get("tool"), questions), *_pointed(words))
    if "replay" in words:
        return (OpenRecording(words["replay"], _seconds(words.get("at", "0")), shown),)
    return shown


def question_commands(word: str | None, known: Mapping[str, str]) -> tuple[Command, ...]:
    """Return the commands that open the debugger with the question of a word; none for None. Raises OptionError.

    `known` maps words to names of questions.
    """
    if not word:
        return ()
    if word not in known:
        raise OptionError(f"This link, or --ask, names the tool “{word}”; there are {', '.join(known)}.")
    return (Ask(Action.QUESTION, known[word]),)


def _pointed(words: dict[str, str]) -> tuple[Command, ...]:
    ends = words["edge"].split("-") if "edge" in words else [words["node"]] if "node" in words else []
    if not all(_NODE.fullmatch(end) for end in ends) or len(ends) != ("edge" in words) + bool(ends):
        raise OptionError("This link selects neither a node nor an edge; it needs edge=12-40 or node=12.")
    return (PointAt(*map(int, ends)),) if ends else ()


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds >= 0):
        raise OptionError(f"This link names the time “{text}”; expected seconds after the beginning, such as at=12.5.")
    return seconds
