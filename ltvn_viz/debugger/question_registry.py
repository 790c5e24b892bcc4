"""The questions of the debugger, in the order of the list: a new one is a module of its own and one line here."""

from typing import Any

from ltvn_viz.debugger.breakpoint_question import BreakpointQuestion
from ltvn_viz.debugger.comparison_question import ComparisonQuestion
from ltvn_viz.debugger.edge_question import EdgeQuestion
from ltvn_viz.debugger.failure_question import FailureQuestion
from ltvn_viz.debugger.ground_truth_question import GroundTruthQuestion
from ltvn_viz.debugger.history_question import HistoryQuestion
from ltvn_viz.debugger.localisation_question import LocalisationQuestion
from ltvn_viz.debugger.manual_edit_question import ManualEditQuestion
from ltvn_viz.debugger.next_drive_question import NextDriveQuestion
from ltvn_viz.debugger.question import Question
from ltvn_viz.debugger.share_question import ShareQuestion
from ltvn_viz.debugger.what_if_question import WhatIfQuestion
from ltvn_viz.debugger.why_question import WhyQuestion
from ltvn_viz.timeline.breakpoint_monitor import BreakpointMonitor


def all_questions(breakpoint_monitor: BreakpointMonitor) -> tuple[Question[Any], ...]:
    """Return a fresh set of questions in the order of the list; breakpoints are kept in `breakpoint_monitor`."""
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
    )
