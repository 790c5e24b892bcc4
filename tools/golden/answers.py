"""Golden answers: every question of the debugger, asked at twelve moments of each of the three demo recordings."""

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ltvn_core.analysis.answer_text import answer_json
from ltvn_core.errors import LtvnError
from ltvn_viz.debugger.file_context import FileCase, JobsAtOnce
from ltvn_viz.debugger.file_questions import FileAsk, ask_file, offered_questions
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


def answers(name: str) -> Iterator[Row]:
    """Yield the answers about one of the recordings."""
    with tempfile.TemporaryDirectory() as folder:  # Questions list the other recordings of a folder by age.
        for each in NAMES:
            copy = shutil.copyfile(RECORDINGS / f"{each}.rrd", Path(folder) / f"{each}.rrd")
            os.utime(copy, (43_200, 43_200))  # Noon of the first day of 1970, which is that day in all time zones.
        for row in _answers(FileCase(Path(folder) / f"{name}.rrd")):
            yield row._replace(value=json.loads(json.dumps(row.value).replace(folder, "recordings")))


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
