"""Golden answers: every question of the debugger at moments of the three demo recordings, and of a run told by hand.

Of the run told by hand they also hold what is drawn, and what texts of all kinds lead to.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ltvn_core.analysis.answer_text import answer_json, answer_text
from ltvn_core.analysis.what_if_changes import WHAT_IF_EXAMPLES
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import LtvnError
from ltvn_core.types import CONTROL_STEP_S, NodeId
from ltvn_viz.debugger.file_context import FileCase, JobsAtOnce
from ltvn_viz.debugger.file_questions import FileAsk, ask_file, offered_questions
from ltvn_viz.debugger.question_registry import all_questions
from ltvn_viz.session.inspection import Overlay, QuestionAnswer
from tools.golden import told
from tools.golden.files import Row, plain

RECORDINGS = Path(__file__).parents[2] / "recordings"
NAMES = ("demo-drive", "demo-fault", "demo-map")
MOMENTS = 12
SELDOM = {"where": 4, "truth": 4}
"""Questions that take seconds, because they look at the whole map: asked at so few of the moments, about no edge."""
TEXTS = {
    "what-if": ("without {0}->{1}", "goal {0}", "D_c = 1.3"),
    "compare": ("demo-map.rrd",),
}
"""Texts for questions that take one; the numbers are the nodes of an edge."""

TOLD_TEXTS = {
    "what-if": (
        *(each.replace("120", "5").replace("12", "4").replace("40", "5") for each in WHAT_IF_EXAMPLES),
        *("with 2->1", "D_l = 0.2", "R_p = 0.95", "belief weight = 0", "failure penalty = 0", "in 2 d", "goal 3"),
        *("without 5->3", "p(5->3) = 1", "p(4->5) = 2", "with 2->99", "goal 99", "R_q = 1", "at 25:00", "12->40"),
    ),
    "compare": ("told.rrd", "before its first query"),
    "edge": ("1 2", "three"),
}


def answers(name: str) -> Iterator[Row]:
    """Yield the answers about one of the recordings."""
    with tempfile.TemporaryDirectory() as folder:  # Questions list the other recordings of a folder by age.
        for each in NAMES:
            copy = shutil.copyfile(RECORDINGS / f"{each}.rrd", Path(folder) / f"{each}.rrd")
            os.utime(copy, (43_200, 43_200))  # Noon of the first day of 1970, which is that day in all time zones.
        for row in _answers(FileCase(Path(folder) / f"{name}.rrd")):
            yield row._replace(value=json.loads(json.dumps(row.value).replace(folder, "recordings")))


def told_answers() -> Iterator[Row]:
    """Yield answers about a run told by hand, with what they draw."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "told.rrd"
        told.write(path, Recording.open(RECORDINGS / "demo-drive.rrd"))
        os.utime(path, (43_200, 43_200))
        case, before = FileCase(path), {}
        for asked, node in _told_asks(case):
            found = _drawn(case, asked, node)
            kind = (asked.question, asked.edge, asked.node, asked.text)
            label = f"{_words(asked)}{'' if node is None else f' after node {node}'}"
            value = "as before" if found == before.get(kind) else found
            yield Row(label, json.loads(json.dumps(value).replace(folder, "recordings")))
            before[kind] = found


def _told_asks(case: FileCase) -> Iterator[tuple[FileAsk, NodeId | None]]:
    """Yield what is asked about the run told by hand, each with the node that was selected before."""
    words = offered_questions(case)
    for step in told.STEPS:
        at_s = step * CONTROL_STEP_S
        for word in words:
            if word in SELDOM and step not in told.TEXT_STEPS:
                continue
            yield FileAsk(question=word, at_s=at_s), None
            yield FileAsk(question=word, at_s=at_s, edge=told.OPEN_AGAIN), None
        for edge in (each for each in told.EDGES if each != told.OPEN_AGAIN):
            yield FileAsk(question="edge", at_s=at_s, edge=edge), None
        for node in (1, 6, 7):
            yield FileAsk(question="edge", at_s=at_s, node=node), 3
        for word, texts in TOLD_TEXTS.items() if step in told.TEXT_STEPS else ():
            for text in texts:
                yield FileAsk(question=word, at_s=at_s, text=text), None


def _drawn(case: FileCase, asked: FileAsk, before: NodeId | None) -> Any:
    """Return the blocks of an answer and what is drawn, or why there is none; `before` was selected before it."""
    jobs = JobsAtOnce()
    context = case.context(asked.at_s or 0.0, jobs)
    question = next(each for each in all_questions(None) if each.word == asked.question)
    selection = replace(asked.selection, before=before)

    def ask() -> QuestionAnswer:
        return question.answer(context, selection)

    try:
        if asked.text:
            ask()
            question.handle_text(context, asked.text)
        found = jobs.complete(ask)
    except LtvnError as error:
        return {"refused": str(error)}
    drawn = [f"{name}: {_short(each)}" for name, value in _parts(found.overlay) for each in value]
    return plain({"told": answer_text(found.answer).splitlines(), "drawn": drawn})


def _parts(overlay: Overlay) -> Iterator[tuple[str, list[Any]]]:
    """Yield what is drawn by the names of its kinds."""
    yield "stroke", [(*each.start, *each.end, *each.colour) for each in overlay.strokes]
    yield "node", [(node, *colour) for node, colour in overlay.nodes.items()]
    yield "ghost", list(overlay.ghosts)
    yield "label", [(each,) for each in overlay.labels]


def _short(numbers: tuple[Any, ...]) -> str:
    return " ".join(f"{each:.2f}" if isinstance(each, float) else str(each) for each in numbers)


def _answers(case: FileCase) -> Iterator[Row]:
    words = offered_questions(case)
    yield Row("questions", words)
    for word in words:
        before: dict[str, Any] = {}
        for moment in range(1, MOMENTS + 1):
            for kind, asked in _asks(case, word, moment).items():
                if kind == "alone" and before and not case.replay.length_s:
                    continue  # A map is one moment, at which other edges are pointed at.
                found = _answer(case, asked)
                if kind == "alone" or found != before["alone"]:  # Most questions do not care what is selected.
                    yield Row(f"moment {moment}: {_words(asked)}", "as before" if found == before.get(kind) else found)
                before[kind] = found


def _asks(case: FileCase, word: str, moment: int) -> Mapping[str, FileAsk]:
    """Return what is asked at a moment: the question alone, about an edge, about a node, and with texts."""
    asked = FileAsk(question=word, at_s=round(case.replay.length_s * moment / MOMENTS, 1))
    if word in SELDOM:
        return {} if moment % (MOMENTS // SELDOM[word]) else {"alone": asked}
    edges = sorted(case.context(asked.at_s or 0.0, JobsAtOnce()).graph.edges)
    if not edges:
        return {"alone": asked}
    edge = edges[len(edges) * moment // (MOMENTS + 1)]
    texts = {text: replace(asked, text=text.format(*edge)) for text in TEXTS.get(word, ())}
    return {"alone": asked, "edge": replace(asked, edge=edge), "node": replace(asked, node=edge[0]), **texts}


def _answer(case: FileCase, asked: FileAsk) -> Any:
    """Return the blocks of an answer, or why there is none."""
    try:
        said = ask_file(case, asked)
    except LtvnError as error:
        return {"refused": str(error)}

    def ask(link: object) -> str | None:
        following = said.asked.following(link)
        return None if following is None else _words(following)

    return plain(answer_json(said.answer, target=ask))


def _words(asked: FileAsk) -> str:
    """Return a question as options of `ltvn why`."""
    return asked.command_line("").partition(" --ask ")[2]
