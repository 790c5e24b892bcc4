"""A recording that is open in a session, asked question by question at a moment. Owns no assertion."""

from contextlib import ExitStack

import numpy as np

from ltvn_core.analysis.answer import Answer, Table
from ltvn_core.analysis.answer_text import line_text
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_viz.debugger.compared_map import BEFORE_FIRST_QUERY
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.options import AppOptions
from ltvn_viz.wishes import commands as c
from tests.repository import RECORDINGS
from tests.viz.app_session import AppSession
from tests.viz.debugger.answer_links import links, words

MOMENTS = 6
_MOST_TICKS = 60


class ReplayedFile(AppSession):
    """A tracked recording, open in a session; what was computed at one moment is there at the next, as in the page."""

    def __init__(self, stack: ExitStack, name: str) -> None:
        """Open it until the stack closes."""
        super().__init__(stack, AppOptions(recordings=RECORDINGS, replay=name))
        self.name = name
        self.do(c.OpenRecording(name), ticks=3)
        self.do(ticks=3)

    @property
    def timeline(self) -> Timeline:
        """All that happened."""
        return self.state.shown_run

    @property
    def instant(self) -> Instant:
        """The moment on show."""
        return self.timeline.instant_at(self.now.moment.stamp)

    @property
    def now_s(self) -> float:
        """Its seconds after the beginning."""
        return self.now.moment.stamp - self.timeline.start_s

    @property
    def known(self) -> int:
        """How many events there were up to now."""
        return self.timeline.count_until(self.instant)

    @property
    def graph(self) -> TopologicalGraph:
        """The map of the moment, from the events."""
        return self.timeline.graph_at(self.instant)

    def moments(self, count: int = MOMENTS) -> list[float]:
        """Return evenly spread moments, seconds, the very first and last among them; one where nothing takes time."""
        length_s = self.timeline.end_s - self.timeline.start_s
        return np.unique(np.linspace(0.0, length_s, count)).tolist()

    def offers(self, question: QuestionName) -> bool:
        """Tell whether a question can be asked now."""
        return question in self.now.inspection.offered

    def answer(self, question: QuestionName) -> Answer:
        """Ask, and wait for what is slow."""
        shown = self.do(c.ChooseQuestion(question), ticks=3)
        for _ in range(_MOST_TICKS):
            if not shown.inspection.answer.answer.is_pending:
                break
            shown = self.do(ticks=2)
        return shown.inspection.answer.answer

    def tables(self, question: QuestionName) -> list[tuple[tuple[str, ...], list[list[str]]]]:
        """Return head and cells of each table of an answer."""
        tables = [block for block in self.answer(question).blocks if isinstance(block, Table)]
        return [(table.head, [[line_text(cell) for cell in row] for row in table.rows]) for table in tables]

    def rows(self, question: QuestionName) -> list[list[str]]:
        """Return the cells of all tables of an answer."""
        return [row for _, rows in self.tables(question) for row in rows]

    def text(self, question: QuestionName) -> str:
        """Return an answer as text."""
        self.answer(question)
        return words(self.now)

    def rows_about(self, question: QuestionName, edge: EdgeKey) -> list[list[str]]:
        """Return the rows of an answer that begin with the edge."""
        return [row for row in self.rows(question) if row[0] == edge_name(edge)]

    def compare_with_the_beginning(self) -> None:
        """Choose the map before the first query to compare with, where it is offered."""
        offered = self.do(c.ChooseQuestion(QuestionName.COMPARE), ticks=3)
        found = [number for number, label in links(offered) if label == BEFORE_FIRST_QUERY]
        if found:
            self.do(c.FollowLink(found[0]), ticks=3)


def edge_name(edge: EdgeKey) -> str:
    """Return an edge as answers write it."""
    return f"{edge[0]} → {edge[1]}"
