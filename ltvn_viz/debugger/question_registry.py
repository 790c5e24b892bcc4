"""The questions of the debugger, in the order of the list; a new question needs its own module and one line here.

Other packages add questions by the entry-point group `ltvn.questions`, `name = "package.module:QuestionClass"`.
"""

import logging
from collections.abc import Iterator, Mapping
from typing import Any

from ltvn_core.errors import PluginError
from ltvn_core.plugins import QUESTIONS, Plugin, find_plugins, load_plugins
from ltvn_viz.debugger.breakpoint_question import BreakpointQuestion
from ltvn_viz.debugger.comparison_question import ComparisonQuestion
from ltvn_viz.debugger.decision_question import DecisionQuestion
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
from ltvn_viz.session.worker import JobQueue
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor

_SERIALS = 2**24
"""Offset between the view numbers of two pages; a page has fewer views than this, so links are unique."""

_LOG = logging.getLogger(__name__)


def all_questions(breakpoint_monitor: BreakpointMonitor) -> tuple[Question[Any], ...]:
    """Return a fresh set of questions in the order of the list, then the installed ones of other packages.

    Breakpoints are kept in `breakpoint_monitor`.
    """
    return (
        EdgeQuestion(),
        HistoryQuestion(),
        DecisionQuestion(),
        WhatIfQuestion(),
        LocalisationQuestion(),
        BreakpointQuestion(breakpoint_monitor),
        ComparisonQuestion(),
        GroundTruthQuestion(),
        FailureQuestion(),
        NextDriveQuestion(),
        ManualEditQuestion(),
        ShareQuestion(),
        *installed_questions(find_plugins(QUESTIONS)),
    )


def watching_inspector(page: int, breakpoint_monitor: BreakpointMonitor, worker: JobQueue) -> Inspector:
    """Return the debugger of a page that only watches: questions without effects, computed in `worker`."""
    questions = [question for question in all_questions(breakpoint_monitor) if question.is_for_watchers]
    return Inspector(questions, worker, first_serial=page * _SERIALS)


def installed_questions(plugins: Mapping[str, Plugin]) -> Iterator[Question[Any]]:
    """Yield the questions of other packages; one that cannot be created is logged and skipped."""
    loaded = load_plugins(plugins, load_question)
    for line in loaded.broken:
        _LOG.warning(line)
    yield from loaded.by_name.values()


def load_question(plugin: Plugin) -> Question[Any]:
    """Create a question of another package. Raises PluginError, and MissingLibraryError if an extra is missing."""
    make = plugin.load()
    if not (isinstance(make, type) and issubclass(make, Question)):
        raise plugin.refusal("is not a class below ltvn_viz.debugger.question.Question")
    try:
        return make()
    except Exception as error:  # Code of other packages may raise any exception.
        raise PluginError(
            f"{plugin.title} cannot be made ({type(error).__name__}: {error}); {plugin.remedy}."
        ) from error
