"""The “Drive” tab: learning, and the switch of the larger picture; without a browser."""

from dataclasses import replace

import viser

from ltvn_viz.panels.drive_panel import DrivePanel, FineTuningPanel
from ltvn_viz.session.snapshot import FineTuningPhase, FineTuningStatus, RecordingStatus, Snapshot
from ltvn_viz.wishes.commands import Action
from ltvn_viz.wishes.modes import Mode
from tests.viz.panels.panel_contents import controls, is_enabled


def test_learning_asks_for_minutes_shows_how_far_it_is_and_offers_what_came_of_it(
    gui: viser.GuiApi, snapshot: Snapshot
) -> None:
    drive, learn = DrivePanel(gui), FineTuningPanel(gui)
    learn.minutes.value = 5
    for status, expected in (
        (FineTuningStatus(drive="a.rrd"), 'data-ltvn-action="learn" data-id="5"'),
        (FineTuningStatus(FineTuningPhase.LEARNING, "a.rrd", 0.42, "learning"), 'data-ltvn-action="stop_learning"'),
        (
            FineTuningStatus(FineTuningPhase.LEARNED, "a.rrd", lines=("Here: fine.",), path="b"),
            'data-ltvn-action="use_weights"',
        ),
        (FineTuningStatus(FineTuningPhase.WORSE, "a.rrd", lines=("Here: bad.",), path="b"), 'data-ltvn-action="learn"'),
        (FineTuningStatus(FineTuningPhase.FAILED, "a.rrd", lines=("<b>no</b>",)), 'data-ltvn-action="learn"'),
    ):
        now = replace(snapshot, fine_tuning=status, weights="abc")
        drive.show(now)
        learn.show(now)
        assert expected in learn.buttons.content
        assert "use_weights" not in learn.buttons.content or status.phase is FineTuningPhase.LEARNED
        assert controls(drive, learn) <= 6
        if status.phase is FineTuningPhase.LEARNING:
            assert 'aria-valuenow="42"' in learn.state.content
    assert "&lt;b&gt;no" in learn.state.content
    assert "abc" not in learn.about.content


def test_learning_is_not_offered_where_there_are_no_weights_to_teach(gui: viser.GuiApi, snapshot: Snapshot) -> None:
    learn = FineTuningPanel(gui)
    learn.show(replace(snapshot, fine_tuning=FineTuningStatus(drive="a.rrd", is_possible=False), weights="geometric-1"))
    assert controls(learn) == 0
    assert "geometric-1" in learn.about.content
    learn.show(replace(snapshot, fine_tuning=FineTuningStatus(drive="a.rrd")))
    assert controls(learn) == 2


def test_new_weights_wait_while_a_recording_or_a_query_is_under_way(gui: viser.GuiApi, snapshot: Snapshot) -> None:
    panel = FineTuningPanel(gui)
    offer = replace(snapshot, fine_tuning=FineTuningStatus(FineTuningPhase.LEARNED))
    panel.show(offer)
    assert is_enabled(panel.buttons.content, Action.USE_WEIGHTS)
    for busy in (replace(offer, mode=Mode.NAVIGATING), replace(offer, recording=RecordingStatus("a.rrd", 1, 0.1))):
        panel.show(busy)
        assert not is_enabled(panel.buttons.content, Action.USE_WEIGHTS)
