"""A link that shows somebody the same thing: recording, time, question, what is pointed at, and from where one looks.

Owns the words of the address, written and read. Nothing in it is trusted: names are looked up in lists, numbers are
checked, and whatever else stands in an address is left alone.
"""

import math
import re
from collections.abc import Mapping
from urllib.parse import parse_qs, urlencode

from ltvn_core.errors import OptionError
from ltvn_viz.server.index_page import LINK_PARAMETERS
from ltvn_viz.session import viewpoint
from ltvn_viz.session.commands import ChooseQuestion, Command, OpenRecording, PointAt, ReportError
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.session.viewpoint import Viewpoint

_NODE = re.compile(r"[0-9]{1,12}", re.ASCII)
_MAX_FIELDS = 32
QUESTION_WORDS: Mapping[str, str] = {name.word: name.value for name in QuestionName if name.word}
"""The names of our own questions by their words."""


def link(
    replay: str,
    at_s: float,
    question: QuestionName = QuestionName.NONE,
    selection: Selection | None = None,
    view: Viewpoint | None = None,
) -> str:
    """Return the address, without host and without key, of a recording at so many seconds after its beginning."""
    words = {"replay": replay, "at": f"{at_s:.2f}".rstrip("0").rstrip(".")}
    if selection is not None and selection.edge is not None:
        words["edge"] = f"{selection.edge[0]}-{selection.edge[1]}"
    elif selection is not None and selection.node is not None:
        words["node"] = str(selection.node)
    if question is not QuestionName.NONE:
        words["tool"] = question.word
    if view is not None:
        words["camera"] = view.word
    return f"/?{urlencode(words, safe=',')}"


def commands_from_link(query: str, questions: Mapping[str, str] = QUESTION_WORDS) -> tuple[Command, ...]:
    """Return what the query of an address asks for, nothing where it asks for nothing. Raises OptionError.

    `questions` has the names of the questions by their words.
    The page itself puts the camera where a link says; one that makes no sense is reported, and the rest is done.
    """
    try:
        fields = parse_qs(query.removeprefix("?"), max_num_fields=_MAX_FIELDS)
    except ValueError as error:
        raise OptionError(f"This link cannot be read ({error}). Ask for it again under “Show somebody”.") from error
    words = {name: fields[name][-1] for name in LINK_PARAMETERS if name in fields}
    shown: tuple[Command, ...] = (*question_commands(words.get("tool"), questions), *_pointed(words))
    if "replay" in words:
        shown = (OpenRecording(words["replay"], _seconds(words.get("at", "0")), shown),)
    return (*shown, *_complaint(words.get("camera")))


def _complaint(camera: str | None) -> tuple[Command, ...]:
    try:
        if camera is not None:
            viewpoint.parse_viewpoint(camera)
    except OptionError as error:
        return (ReportError(str(error)),)
    return ()


def question_commands(word: str | None, known: Mapping[str, str]) -> tuple[Command, ...]:
    """Return what opens the debugger with the question of a word, nothing for none. Raises OptionError.

    `known` has the names of the questions by their words.
    """
    if not word:
        return ()
    if word not in known:
        raise OptionError(f"This link, or --ask, names the tool “{word}”; there are {', '.join(known)}.")
    return (ChooseQuestion(known[word]),)


def _pointed(words: dict[str, str]) -> tuple[Command, ...]:
    ends = words["edge"].split("-") if "edge" in words else [words["node"]] if "node" in words else []
    if not all(_NODE.fullmatch(end) for end in ends) or len(ends) != ("edge" in words) + bool(ends):
        raise OptionError("This link points at something that is no node and no edge; want edge=12-40 or node=12.")
    return (PointAt(*map(int, ends)),) if ends else ()


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds >= 0):
        raise OptionError(f"This link names the time “{text}”; want seconds after the beginning, such as at=12.5.")
    return seconds
