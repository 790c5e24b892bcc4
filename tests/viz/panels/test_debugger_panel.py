"""The “Why” tab on a viser server: the questions as buttons."""

import viser

from ltvn_viz.panels.debugger_panel import DebuggerPanel
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.session.snapshot import Snapshot

OFFERED = (QuestionName.FIRST, QuestionName.EDGE, QuestionName.TIME, "<b>Mine</b>")


def test_the_question_asked_is_pressed_and_the_rarer_ones_are_under_more(gui: viser.GuiApi) -> None:
    panel = DebuggerPanel(gui, lambda _: None)
    panel.show(Snapshot(inspection=Inspection(QuestionName.EDGE, offered=OFFERED)))
    row, _, more = panel._questions.content.partition("<details>")
    assert row.count('aria-pressed="true"') == 1
    assert 'aria-pressed="true" data-ltvn-action="question" data-text="What about this edge?"' in row
    assert "What happened when?" in more
    assert "<b>Mine</b>" not in row + more
    gui.reset()
