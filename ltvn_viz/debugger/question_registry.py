"""The questions of the debugger, in the order of the list; a new question needs its own module and one line here.

Other packages add questions by the entry-point group `ltvn.questions`, `name = "package.module:QuestionClass"`.
"""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import EntryPoint
from typing import Any

from ltvn_core.errors import LtvnError
from ltvn_core.plugins import QUESTIONS, Plugin, find_plugins
from ltvn_viz.debugger.breakpoint_question import BreakpointQuestion
from ltvn_viz.debugger.comparison_question import ComparisonQuestion
from ltvn_viz.debugger.decision_question import DecisionQuestion
from ltvn_viz.debugger.edge_question import EdgeQuestion
from ltvn_viz.debugger.failure_question import FailureQuestion
from ltvn_viz.debugger.first_question import FirstQuestion
from ltvn_viz.debugger.ground_truth_question import GroundTruthQuestion
from ltvn_viz.debugger.guarded_question import GuardedQuestion
from ltvn_viz.debugger.history_question import HistoryQuestion
from ltvn_viz.debugger.localisation_question import LocalisationQuestion
from ltvn_viz.debugger.manual_edit_question import ManualEditQuestion
from ltvn_viz.debugger.next_drive_question import NextDriveQuestion
from ltvn_viz.debugger.question import Question
from ltvn_viz.debugger.share_question import ShareQuestion
from ltvn_viz.debugger.what_if_question import WhatIfQuestion
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor

_LOG = logging.getLogger(__name__)


def all_questions(
    breakpoint_monitor: BreakpointMonitor | None, added: Sequence[Callable[[], Any]] = ()
) -> tuple[Question[Any], ...]:
    """Return a fresh set of questions in the order of the list, then the installed ones of other packages, then those
    of the classes `added`.

    Breakpoints are kept in `breakpoint_monitor`; without one, nothing can be stopped, and no question offers them. A
    question of others that cannot be used is logged and left out.
    """
    own = (
        FirstQuestion(),
        EdgeQuestion(),
        HistoryQuestion(),
        DecisionQuestion(),
        WhatIfQuestion(),
        LocalisationQuestion(),
        *(() if breakpoint_monitor is None else (BreakpointQuestion(breakpoint_monitor),)),
        ComparisonQuestion(),
        GroundTruthQuestion(),
        FailureQuestion(),
        NextDriveQuestion(),
        ManualEditQuestion(),
        ShareQuestion(),
    )
    return (*own, *installed_questions(find_plugins(QUESTIONS), own, added))


def installed_questions(
    plugins: Mapping[str, Plugin], own: Sequence[Question[Any]] = (), added: Sequence[Callable[[], Any]] = ()
) -> Iterator[Question[Any]]:
    """Yield the questions of other packages and of the classes `added`.

    One that cannot be made, or whose name or word one before it has, is logged and left out.
    """
    taken = {text for question in own for text in _named(question)}
    makers = [*((plugin, plugin.load) for plugin in plugins.values()), *map(_unpackaged, added)]
    for plugin, load in makers:
        try:
            question = make_question(plugin, load())
            if clash := taken.intersection(_named(question)):
                raise plugin.refusal(f"has the name or word {min(clash)!r} of another question")
        except LtvnError as error:
            _LOG.warning(str(error))
            continue
        taken.update(_named(question))
        yield question


def make_question(plugin: Plugin, make: object) -> GuardedQuestion:
    """Create the question that a plug-in holds. Raises PluginError, and MissingLibraryError if an extra is missing."""
    if not (isinstance(make, type) and issubclass(make, Question)):
        raise plugin.refusal("is not a class below ltvn_viz.debugger.question.Question")
    with plugin.running("cannot be made"):
        question: Question[Any] = make()
    return GuardedQuestion(plugin, question)


def _unpackaged(make: Callable[[], Any]) -> tuple[Plugin, Callable[[], object]]:
    """Return a class that no package names as if one did, for its messages."""
    name = getattr(make, "__qualname__", repr(make))
    return Plugin(QUESTIONS, EntryPoint(name, f"{make.__module__}:{name}", QUESTIONS.name)), lambda: make


def _named(question: Question[Any]) -> set[str]:
    return {question.name, question.word, *question.earlier_words}
