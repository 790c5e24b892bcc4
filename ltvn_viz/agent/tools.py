"""The tools that programs call: they list and describe files, and return the debugger's answers and images.

Owns the arguments and the result of each tool, and the limits of its size. All tools are read-only. They are
independent of the protocol, which is in `server`.
"""

import io
import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from PIL import Image

from ltvn_core.analysis.answer_text import answer_text
from ltvn_core.analysis.timeline_records import QueryRecord
from ltvn_core.analysis.timeline_rows import STOPS
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.evaluation.reports.map_png import map_png
from ltvn_core.evaluation.reports.map_svg import map_layout
from ltvn_core.terminal_text import shown_plainly, which_name
from ltvn_viz.agent import arguments as a
from ltvn_viz.agent.arguments import Parameter, read_arguments
from ltvn_viz.agent.named_files import NamedFiles
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.debugger.file_questions import LONGEST_TEXT, FileAnswer, FileAsk, ask_file, offered_questions

MOST_FILES = 200
MOST_QUERIES = 50
MOST_MARKS = 500
MOST_LINKS = 40
LONGEST_ANSWER = 12_000
"""Maximum number of characters of an answer, about 3000 tokens of a language model."""
LARGEST_IMAGE = 768
"""Maximum length of the longer side of an image, in pixels."""
LONGEST_S = 60.0
"""Time limit for an answer, in seconds; programs that call tools seldom wait longer."""
_MARKS = 100
_LOG = logging.getLogger(__name__)

_FILE = a.text("file", "A name from list_files.", longest=1000, required=True)
_AT = a.number("at_s", "Seconds after the beginning of the recording; the end if not given.")


@dataclass(frozen=True, kw_only=True)
class ToolImage:
    """An image as the result of a tool."""

    data: bytes
    mime_type: str


@dataclass(frozen=True, kw_only=True)
class ToolError:
    """The reason why there is no answer, and a description of valid arguments."""

    text: str


ToolResult = dict[str, Any] | ToolImage | ToolError


@dataclass(frozen=True, kw_only=True)
class Tool:
    """A function that a program may call."""

    name: str
    about: str
    parameters: tuple[Parameter, ...]
    do: Callable[..., dict[str, Any] | ToolImage]
    """Function that takes the arguments by name. Raises LtvnError."""


class RecordingTools:
    """The tools for some files. For one thread at a time."""

    def __init__(self, files: NamedFiles) -> None:
        """Let the tools read only these files."""
        self._files = files
        self.calls = 0
        self.refused = 0
        self.tools: Mapping[str, Tool] = {tool.name: tool for tool in self._tools()}

    def call(self, name: str, given: Mapping[str, object]) -> ToolResult:
        """Check the arguments from a program and call the tool; every failure is returned as a ToolError."""
        self.calls += 1
        try:
            if name not in self.tools:
                raise OptionError(f"There is no tool {name[:60]!r}. {which_name(name[:60], self.tools)}.")
            tool = self.tools[name]
            return tool.do(**read_arguments(tool.parameters, given))
        except (LtvnError, OSError) as error:
            text = str(error)
        except Exception as error:  # No request of a program may end the server.
            _LOG.exception("The tool %.60s failed", name)
            text = f"This could not be answered ({type(error).__name__}); ask with other arguments."
        self.refused += 1
        return ToolError(text=shown_plainly(text)[:LONGEST_ANSWER])

    def _tools(self) -> Sequence[Tool]:
        return (
            Tool(name="list_files", about=_ABOUT_FILES, parameters=(), do=self._list_files),
            Tool(name="describe", about=_ABOUT_DESCRIBE, parameters=(_FILE,), do=self._describe),
            Tool(name="timeline", about=_ABOUT_TIMELINE, parameters=_TIMELINE, do=self._timeline),
            Tool(name="ask", about=_ABOUT_ASK, parameters=_ASK, do=self._ask),
            Tool(name="image", about=_ABOUT_IMAGE, parameters=(_FILE, _FRAME), do=self._image),
            Tool(name="map_picture", about=_ABOUT_MAP, parameters=(_FILE, _AT), do=self._map_picture),
        )

    def _list_files(self) -> dict[str, Any]:
        files = [*self._files.by_name.items()]
        rows = [{"file": name, "size_bytes": path.stat().st_size} for name, path in files[:MOST_FILES] if path.exists()]
        return {"files": rows, "left_out": max(0, len(files) - MOST_FILES)}

    def _describe(self, file: str) -> dict[str, Any]:
        case = self._files.case(file)
        timeline = case.timeline
        graph = case.timeline.graph_at()
        return {
            "file": file,
            "scene": case.replay.scene,
            "system": case.replay.system or None,
            "length_s": round(case.replay.length_s, 3),
            "frames": _frames(case),
            "map_at_end": {"nodes": len(graph.nodes), "edges": len(graph.edges)},
            "queries": [_query_row(case, query) for query in timeline.queries[-MOST_QUERIES:]],
            "queries_left_out": max(0, len(timeline.queries) - MOST_QUERIES),
            "happened": {kind.value: count for kind, count in Counter(mark.kind for mark in timeline.marks).items()},
            "questions": offered_questions(case),
            "notes": list(timeline.notes[:MOST_QUERIES]),
        }

    def _timeline(
        self,
        file: str,
        from_s: float = 0.0,
        to_s: float | None = None,
        kinds: tuple[str, ...] = (),
        most: int = _MARKS,
    ) -> dict[str, Any]:
        case = self._files.case(file)
        until = case.replay.length_s if to_s is None else to_s
        if until < from_s:
            raise OptionError(f"to_s is before from_s: {until:g} < {from_s:g}.")
        found = [
            mark
            for mark in case.timeline.marks
            if from_s - _EARLY_S <= _seconds(case, mark.instant.stamp) <= until + _EARLY_S
            and (not kinds or mark.kind.value in kinds)
        ]
        rows = [
            {
                "at_s": round(_seconds(case, mark.instant.stamp), 3),
                "kind": mark.kind.value,
                "about": list(mark.ids),
                "text": mark.text,
            }
            for mark in found[:most]
        ]
        return {
            "file": file,
            "length_s": round(case.replay.length_s, 3),
            "rows": rows,
            "left_out": len(found) - len(rows),
        }

    def _ask(self, file: str, **told: Any) -> dict[str, Any]:
        said = ask_file(self._files.case(file), FileAsk(**told), longest_s=LONGEST_S)
        text = answer_text(said.answer)
        return {
            "file": file,
            "question": said.asked.word,
            "at_s": said.asked.at_s,
            "about": said.asked.about,
            "text": text[:LONGEST_ANSWER],
            "letters_left_out": max(0, len(text) - LONGEST_ANSWER),
            "follow": _links(said),
        }

    def _image(self, file: str, frame: int) -> ToolImage:
        case = self._files.case(file)
        seen = case.replay.observation(frame)
        if seen is None:
            raise OptionError(f"{file} has no image of frame {frame}; its frames are {_frames(case)}.")
        picture = Image.fromarray(seen.rgb)
        picture.thumbnail((LARGEST_IMAGE, LARGEST_IMAGE))
        written = io.BytesIO()
        picture.save(written, "JPEG", quality=85)
        return ToolImage(data=written.getvalue(), mime_type="image/jpeg")

    def _map_picture(self, file: str, at_s: float | None = None) -> ToolImage:
        case = self._files.case(file)
        stamp = None if at_s is None else case.timeline.start_s + at_s
        return ToolImage(data=map_png(map_layout(Recording.open(case.path), at_s=stamp)), mime_type="image/png")


_EARLY_S = 1e-3
"""Tolerance of the time limits in seconds, because times in results are rounded to milliseconds."""

_FRAME = a.whole("frame", "The number of an image; the number of a node is the number of its image.", required=True)
_TIMELINE = (
    _FILE,
    a.number("from_s", "Seconds after the beginning; 0 if not given."),
    a.number("to_s", "Seconds after the beginning; the end if not given."),
    a.choices("kinds", "Only events of these kinds; all if not given.", [kind.value for kind in STOPS]),
    a.whole("most", f"Largest number of rows, from the first on; {_MARKS} if not given.", least=1, most=MOST_MARKS),
)
_ASK = (
    _FILE,
    a.text(
        "question", "The word of a question from describe; if not given, edge, or failures for a query.", longest=60
    ),
    _AT,
    a.edge("edge", "Point at the edge between two nodes, from and to, whether or not the map has it."),
    a.whole("node", "Point at a node."),
    a.whole("query", "Point at a navigation task, by its number."),
    a.text(
        "text", "The text that a person would type, for instance for what-if: without 12->40.", longest=LONGEST_TEXT
    ),
)
_ABOUT_FILES = "List the recordings and maps that can be asked about. Begin here."
_ABOUT_DESCRIBE = (
    "Describe a recording or a map: length, images, map, navigation tasks (queries) with their outcomes, numbers of "
    "events, and the questions that can be asked."
)
_ABOUT_TIMELINE = (
    "List what happened in a stretch of time: queries, failures, plans, edges that were added and removed."
)
_ABOUT_ASK = (
    "Ask the debugger a question about a moment. `failures` explains failed queries, `edge` explains an edge or a "
    "node, `truth` (in simulation) lists wrong and missing edges, `what-if` plans again after a change. `follow` in "
    "the answer has the arguments of the next questions."
)
_ABOUT_IMAGE = "Show an image that the robot took, by its frame; a node's number is the frame of its image."
_ABOUT_MAP = "Draw the map at a moment, with the known floor."


def _seconds(case: FileCase, stamp: float) -> float:
    return stamp - case.timeline.start_s


def _frames(case: FileCase) -> dict[str, int]:
    frames = case.timeline.frames
    if not len(frames):
        return {"count": 0}
    return {"count": len(frames), "first": frames.step(0), "last": frames.step(len(frames) - 1)}


def _query_row(case: FileCase, query: QueryRecord) -> dict[str, Any]:
    return {
        "query": query.id,
        "goal": query.goal,
        "begin_s": round(_seconds(case, query.begin.stamp), 3),
        "end_s": None if query.end is None else round(_seconds(case, query.end.stamp), 3),
        "outcome": None if query.outcome is None else query.outcome.value,
        "succeeded": query.succeeded,
    }


def _links(said: FileAnswer) -> list[dict[str, Any]]:
    """Return the targets of an answer's links, each target once."""
    found: dict[str, dict[str, Any]] = {}
    for link in said.answer.links():
        following = said.asked.following(link.to)
        if following is not None and following != said.asked:
            found.setdefault(str(following), {"label": link.label, "ask": following.arguments()})
    return [*found.values()][:MOST_LINKS]
