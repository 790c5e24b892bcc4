"""Links that show another person the same view: recording, time, question, selection and camera.

Owns the format of the address, for writing and reading. Addresses are untrusted: names are looked up in lists, numbers
are checked, and everything else is ignored.

A camera view is nine numbers. `static/links.js` also checks them before it passes them to viser, whose page moves the
camera.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias
from urllib.parse import parse_qs, urlencode

import numpy as np
import viser
from numpy.typing import NDArray

from ltvn_core.errors import OptionError
from ltvn_viz.server.index_page import LINK_PARAMETERS
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.wishes.commands import ChooseQuestion, Command, OpenRecording, PointAt, ReportError

Point: TypeAlias = tuple[float, float, float]

FARTHEST_M = 10_000.0
_CLOSEST_M = 0.001
_NINE = re.compile(r"[-+0-9.e]+(,[-+0-9.e]+){8}", re.ASCII)
_REFUSAL = (
    "This link has an invalid view, so the view did not change; expected camera= with nine numbers: position, target "
    "and up vector."
)


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera in the scene; metres."""

    position: Point
    look_at: Point
    up: Point

    @property
    def word(self) -> str:
        """The view as text for an address, rounded to millimetres."""
        return ",".join(f"{number:.3f}".rstrip("0").rstrip(".") for number in (*self.position, *self.look_at, *self.up))


def parse_viewpoint(word: str) -> Viewpoint:
    """Parse the view in an address. Raises OptionError."""
    try:
        numbers = [float(part) for part in word.split(",")] if _NINE.fullmatch(word) else []
    except ValueError:
        numbers = []
    if not numbers or not all(abs(number) <= FARTHEST_M for number in numbers):
        raise OptionError(_REFUSAL)
    view = Viewpoint(_point(numbers[:3]), _point(numbers[3:6]), _point(numbers[6:]))
    if math.dist(view.position, view.look_at) < _CLOSEST_M or math.hypot(*view.up) < _CLOSEST_M:
        raise OptionError(_REFUSAL)
    return view


def latest_viewpoint(clients: Iterable[viser.ClientHandle]) -> Viewpoint | None:
    """Return the view of the page whose camera was moved last; None without a page."""
    cameras = [client.camera for client in clients]
    if not cameras:
        return None
    camera = max(cameras, key=lambda each: each.update_timestamp)
    return Viewpoint(_rounded(camera.position), _rounded(camera.look_at), _rounded(camera.up_direction))


def _point(numbers: Iterable[float]) -> Point:
    x, y, z = numbers
    return x, y, z


def _rounded(point: NDArray[np.float64]) -> Point:
    """Round to millimetres, so that a resting camera gives a constant view."""
    return _point(round(float(number), 3) + 0.0 for number in point)


_NODE = re.compile(r"[0-9]{1,12}", re.ASCII)
_MAX_FIELDS = 32
QUESTION_WORDS: Mapping[str, str] = {
    word: name.value for name in QuestionName for word in (name.word, *name.earlier_words) if word
}
"""Names of our own questions, by their words in addresses."""


def link(
    replay: str,
    at_s: float,
    question: QuestionName = QuestionName.NONE,
    selection: Selection | None = None,
    view: Viewpoint | None = None,
) -> str:
    """Return the address, without host and key, of a recording at a time in seconds after its beginning."""
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
    """Return the commands in the query of an address, none if it has none. Raises OptionError.

    `questions` maps words to names of questions. The page itself moves the camera; an invalid camera is reported, and
    all other commands are returned.
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
            parse_viewpoint(camera)
    except OptionError as error:
        return (ReportError(str(error)),)
    return ()


def question_commands(word: str | None, known: Mapping[str, str]) -> tuple[Command, ...]:
    """Return the commands that open the debugger with the question of a word; none for None. Raises OptionError.

    `known` maps words to names of questions.
    """
    if not word:
        return ()
    if word not in known:
        raise OptionError(f"This link, or --ask, names the tool “{word}”; there are {', '.join(known)}.")
    return (ChooseQuestion(known[word]),)


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
