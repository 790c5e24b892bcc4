"""The “Why” tab on a viser server: whose question its list shows."""

from collections.abc import Iterator

import pytest
import viser

from ltvn_viz.panels.debugger_panel import ANSWERED_WITHIN_S, DebuggerPanel
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.session.snapshot import Snapshot

OFFERED = (QuestionName.NONE, QuestionName.EDGE, QuestionName.TIME)
BEFORE = Snapshot(inspection=Inspection(offered=OFFERED))


class Panel:
    """The panel, a clock, and a person."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.seconds_later = 0.0
        self.panel = DebuggerPanel(
            gui, lambda _action, _value: None, clock=lambda: self.list.update_timestamp + self.seconds_later
        )
        self.panel.show(BEFORE)

    @property
    def list(self) -> viser.GuiDropdownHandle[str]:
        """The list of questions."""
        return self.panel._tools

    def choose(self, question: QuestionName) -> None:
        """Set the list as viser does when a page says so, before it calls anybody."""
        self.list._impl.value = question.value


@pytest.fixture
def panel(gui: viser.GuiApi) -> Iterator[Panel]:
    yield Panel(gui)
    gui.reset()


def test_a_choice_is_not_lost_to_a_snapshot_from_before_it(panel: Panel) -> None:
    panel.choose(QuestionName.EDGE)
    panel.panel.show(BEFORE)
    assert panel.list.value == QuestionName.EDGE


def test_a_choice_that_nobody_answers_is_taken_back(panel: Panel) -> None:
    panel.choose(QuestionName.EDGE)
    panel.seconds_later = 2 * ANSWERED_WITHIN_S
    panel.panel.show(BEFORE)
    assert panel.list.value == QuestionName.NONE


def test_a_question_of_the_session_is_shown_at_once(panel: Panel) -> None:
    for question in (QuestionName.TIME, QuestionName.EDGE):
        panel.panel.show(Snapshot(inspection=Inspection(question, offered=OFFERED)))
        assert panel.list.value == question
