"""The questions of the debugger, in the order of the list: a new one is a module of its own and one line here.

Other packages add theirs by the entry-point group `ltvn.questions`, `name = "package.module:QuestionClass"`.
"""

import logging
from collections.abc import Iterable, Iterator
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ltvn_viz.debugger.breakpoint_question import BreakpointQuestion
from ltvn_viz.debugger.comparison_question import ComparisonQuestion
from ltvn_viz.debugger.edge_question import EdgeQuestion
from ltvn_viz.debugger.failure_question import FailureQuestion
from ltvn_viz.debugger.ground_truth_question import GroundTruthQuestion
from ltvn_viz.debugger.history_question import HistoryQuestion
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.localisation_question import LocalisationQuestion
from ltvn_viz.debugger.manual_edit_question import ManualEditQuestion
from ltvn_viz.debugger.next_drive_question import NextDriveQuestion
from ltvn_viz.debugger.question import Question
from ltvn_viz.debugger.share_question import ShareQuestion
from ltvn_viz.debugger.what_if_question import WhatIfQuestion
from ltvn_viz.debugger.why_question import WhyQuestion
from ltvn_viz.session.worker import JobQueue
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor

GROUP = "ltvn.questions"
"""Name of the entry-point group."""

_SERIALS = 2**24
"""So many views of a page can be counted before its links look like those of the next."""

_LOG = logging.getLogger(__name__)


def all_questions(breakpoint_monitor: BreakpointMonitor) -> tuple[Question[Any], ...]:
    """Return a fresh set of questions in the order of the list, then the installed ones of other packages.

    Breakpoints are kept in `breakpoint_monitor`.
    """
    return (
        EdgeQuestion(),
        WhyQuestion(),
        HistoryQuestion(),
        WhatIfQuestion(),
        LocalisationQuestion(),
        BreakpointQuestion(breakpoint_monitor),
        ComparisonQuestion(),
        GroundTruthQuestion(),
        FailureQuestion(),
        NextDriveQuestion(),
        ManualEditQuestion(),
        ShareQuestion(),
        *installed_questions(entry_points(group=GROUP)),
    )


def watching_inspector(page: int, breakpoint_monitor: BreakpointMonitor, worker: JobQueue) -> Inspector:
    """Return the debugger of a page that only watches: the questions that change nothing, computed in `worker`."""
    questions = [question for question in all_questions(breakpoint_monitor) if question.is_for_watchers]
    return Inspector(questions, worker, first_serial=page * _SERIALS)


def installed_questions(entries: Iterable[EntryPoint]) -> Iterator[Question[Any]]:
    """Yield the questions that other packages offer; one that cannot be made is named in the log and left out."""
    for entry in sorted(entries, key=lambda entry: entry.name):
        try:
            question = entry.load()()
        except Exception as error:  # Another person's code may raise anything.
            _LOG.warning("The question %s cannot be loaded (%s: %s).", entry.name, type(error).__name__, error)
            continue
        if isinstance(question, Question):
            yield question
        else:
            _LOG.warning("%s is no question; derive it from ltvn_viz.debugger.question.Question.", entry.value)
