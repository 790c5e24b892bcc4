"""Decisions of the robot in the current query, with the rule and the number behind each.

Owns the layout of the answer; `ltvn_core.analysis.decisions` finds the rule behind each event.
"""

from typing import Never

from ltvn_core.analysis.answer import Hint, Inline, Step
from ltvn_core.analysis.decisions import Decision, query_decisions
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, has_query, time_link
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection

_ROWS = 24
"""Number of latest decisions that are shown; earlier ones are shown at earlier moments."""


class DecisionQuestion(Question[Never]):
    """Shows the decisions and their rules."""

    name = QuestionName.DECISIONS
    is_offered = has_query
    about = "Each decision of the query with the rule and the number behind it, the latest first."

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """List the decisions of the query up to the moment."""
        builder = AnswerBuilder()
        query = context.latest_query if selection.query is None else context.query(selection.query)
        if query is None:
            builder.add_line("No query has begun yet.")
            return builder.build()
        decisions = query_decisions(context.timeline, query.id, context.method, until=context.instant)
        shown = decisions[-_ROWS:]
        builder.add_line(f"Query {query.id} to node {query.goal}: {len(decisions)} decisions up to now.")
        builder.add_table(("when", "decision", "because of"), [_row(context, each) for each in reversed(shown)])
        if len(shown) < len(decisions):
            earlier = Step("go back in time to see earlier ones.", "ask --at an earlier time for others.")
            builder.add_line(f"The latest {_ROWS} are shown; ", earlier)
        return builder.build()


def _row(context: DebugContext, decision: Decision) -> tuple[Inline, ...]:
    named = ", ".join(rule.rule for rule in decision.rules)
    rules = Hint("; ".join(rule.text for rule in decision.rules), f"In config.py: {named}") if named else "no choice"
    return (time_link(context.seconds(decision.instant)), decision.text, rules)
