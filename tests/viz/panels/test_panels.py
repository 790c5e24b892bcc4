"""Panels against a real viser server without a browser."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser

from ltvn_core.navigation.events import Severity
from ltvn_viz.painter import Painter
from ltvn_viz.panels.camera_panel import CameraPanel, colour_beside_depth, depth_colours
from ltvn_viz.panels.drive_panel import DrivePanel
from ltvn_viz.panels.fine_tuning_panel import FineTuningPanel
from ltvn_viz.panels.follow_camera import FollowCamera
from ltvn_viz.panels.html_widgets import HtmlBlock, with_keys
from ltvn_viz.panels.legend_panel import LegendPanel
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.notifications import SECONDS, Notifications
from ltvn_viz.panels.replay_panel import ReplayPanel
from ltvn_viz.panels.status_panel import StatusPanel
from ltvn_viz.server.keymap import Action
from ltvn_viz.server.thumbnails import LIMIT, ThumbnailStore
from ltvn_viz.session import commands as c
from ltvn_viz.session.goals import farthest_points
from ltvn_viz.session.inspection import QuestionAnswer
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.overlay import Overlay
from ltvn_viz.session.snapshot import (
    CameraImage,
    FineTuningPhase,
    FineTuningStatus,
    JobProgress,
    Message,
    PlaybackStatus,
    RecordingStatus,
    Snapshot,
)
from tests.viz.session_harness import SessionHarness


@pytest.fixture
def snapshot(tmp_path: Path) -> Snapshot:
    return SessionHarness(tmp_path).wait(2)


def nothing(_: c.Command | bytes) -> None:
    """Take a command and forget it."""


def test_html_in_messages_and_names_is_shown_as_text(server: viser.ViserServer) -> None:
    evil = "<img src=x onerror=alert(1)>"
    now = [0.0]
    status = StatusPanel(server.gui, clock=lambda: now[0])
    status.show(Snapshot(hint=evil, message=Message(evil, Severity.ERROR, 1)))
    now[0] += SECONDS[Severity.ERROR] + 1
    status.show(Snapshot(hint=evil, message=Message(evil, Severity.ERROR, 1)))
    replay = ReplayPanel(server.gui, nothing)
    replay.show(Snapshot(mode=Mode.REPLAY, replay=PlaybackStatus(evil, 1.0, 0.0, playing=False), recordings=(evil,)))
    for markup in (status.hint, status.message, replay.about):
        assert "<img" not in markup.content
        assert "&lt;img" in markup.content


def test_a_sentence_with_several_keys_names_none_of_them_to_a_finger() -> None:
    shown = with_keys("Take over with W A S D, stop with Space.")
    to_a_finger = re.sub(r'<span class="ltvn-by-key">.*?</span>', "", shown)
    assert re.sub("<.*?>", "", to_a_finger) == "Take over with an arrow, stop with Stop."


def test_the_status_line_says_mode_health_and_what_is_recorded_and_has_the_numbers_at_hand(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    status = StatusPanel(server.gui)
    rates = replace(snapshot.rates, loop_hz=29.7, frame_age_ms=41.0, dropped=7)
    status.show(replace(snapshot, rates=rates, recording=RecordingStatus("a.rrd", 12, 3.0)))
    line = status.line.content
    for part in ("driving", ">Good<", ">12<", "30 times a second", "41 ms", ">7<"):
        assert part in line


def test_numbers_are_refreshed_twice_a_second_but_the_mode_at_once(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    status = StatusPanel(server.gui, clock=lambda: 0.0)
    status.show(snapshot)
    first = status.line.content
    status.show(replace(snapshot, rates=replace(snapshot.rates, loop_hz=3.0)))
    assert status.line.content == first
    status.show(replace(snapshot, mode=Mode.PAUSED))
    assert "paused" in status.line.content


def test_a_message_is_never_in_the_panel_while_its_notification_says_it(server: viser.ViserServer) -> None:
    now = [0.0]
    status = StatusPanel(server.gui, clock=lambda: now[0])
    for severity in Severity:
        told = Snapshot(message=Message("a word", severity, 1))
        status.show(replace(told, message=None))
        status.show(told)
        assert status.message.content == ""
        now[0] += SECONDS[severity] + 1
        status.show(told)
        assert ("a word" in status.message.content) == (severity is Severity.ERROR)


def test_work_is_shown_with_what_is_done_of_how_much(server: viser.ViserServer, snapshot: Snapshot) -> None:
    status = StatusPanel(server.gui)
    status.show(replace(snapshot, work=JobProgress("Building the map", 840, 2000)))
    assert "Building the map… 840 of 2,000 images, 42 %" in status.message.content
    assert 'aria-valuenow="42"' in status.message.content
    status.show(replace(snapshot, work=JobProgress("Importing a.mp4", 840)))
    assert "Importing a.mp4… 840 images so far" in status.message.content


def is_enabled(html: str, action: Action) -> bool:
    """Tell whether the first button of an action can be pressed."""
    button = next(part for part in html.split("<button") if f'data-ltvn-action="{action}"' in part)
    return " disabled" not in button.split(">")[0]


def test_recording_buttons_follow_what_makes_sense(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = DrivePanel(server.gui)
    panel.show(snapshot)
    html = panel.recording.content
    assert is_enabled(html, Action.RECORD)
    assert not is_enabled(html, Action.KEEP)
    panel.show(replace(snapshot, recording=RecordingStatus("a.rrd", 1, 0.1)))
    html = panel.recording.content
    assert not is_enabled(html, Action.RECORD)
    assert is_enabled(html, Action.KEEP)
    assert is_enabled(html, Action.DISCARD)


def test_building_a_map_can_be_cancelled_where_it_was_begun(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = DrivePanel(server.gui)
    panel.show(replace(snapshot, mode=Mode.BUILDING))
    assert is_enabled(panel.map.content, Action.CANCEL)
    panel.show(snapshot)
    assert Action.CANCEL not in panel.map.content


def test_the_legend_is_bright_for_what_is_shown_now(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = LegendPanel(server.gui)

    def is_bright(name: str) -> bool:
        item = next(part for part in panel.legend.content.split("<span") if f"</i>{name}</span>" in part)
        return 'data-shown="1"' in item

    panel.show(Snapshot())
    assert not is_bright("node")
    assert not is_bright("goal")
    panel.show(replace(snapshot, selected=snapshot.gallery[0]))
    assert is_bright("node")
    assert is_bright("goal")
    assert not is_bright("pruned or blocked edge")
    assert "alike" not in panel.legend.content
    answer = QuestionAnswer("", overlay=Overlay(is_of_likeness=True))
    panel.show(replace(snapshot, inspection=replace(snapshot.inspection, answer=answer)))
    assert "alike" in panel.legend.content


def controls(*panels: object) -> int:
    """Count the buttons and boxes that panels of one tab show."""
    parts = [part for panel in panels for part in vars(panel).values()]
    shown = [part for part in parts if isinstance(part, viser.GuiInputHandle) and part.visible]
    return len(shown) + sum(part.content.count("<button") for part in parts if isinstance(part, HtmlBlock))


def test_learning_asks_for_minutes_shows_how_far_it_is_and_offers_what_came_of_it(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    drive, learn, follow = DrivePanel(server.gui), FineTuningPanel(server.gui), FollowCamera(server.gui, list)
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
        assert controls(drive, learn, follow) <= 7
        if status.phase is FineTuningPhase.LEARNING:
            assert 'aria-valuenow="42"' in learn.state.content
    assert "&lt;b&gt;no" in learn.state.content
    assert "abc" not in learn.about.content


def test_learning_is_not_offered_where_there_are_no_weights_to_teach(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    learn = FineTuningPanel(server.gui)
    learn.show(replace(snapshot, fine_tuning=FineTuningStatus(drive="a.rrd", is_possible=False), weights="geometric-1"))
    assert controls(learn) == 0
    assert "geometric-1" in learn.about.content
    learn.show(replace(snapshot, fine_tuning=FineTuningStatus(drive="a.rrd")))
    assert controls(learn) == 2


def test_new_weights_wait_while_a_recording_or_a_query_is_under_way(
    server: viser.ViserServer, snapshot: Snapshot
) -> None:
    panel = FineTuningPanel(server.gui)
    offer = replace(snapshot, fine_tuning=FineTuningStatus(FineTuningPhase.LEARNED))
    panel.show(offer)
    assert is_enabled(panel.buttons.content, Action.USE_WEIGHTS)
    for busy in (replace(offer, mode=Mode.NAVIGATING), replace(offer, recording=RecordingStatus("a.rrd", 1, 0.1))):
        panel.show(busy)
        assert not is_enabled(panel.buttons.content, Action.USE_WEIGHTS)


def test_a_running_query_can_be_paused_stepped_and_cancelled(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = NavigationPanel(server.gui, nothing)
    panel.show(replace(snapshot, mode=Mode.NAVIGATING))
    for action in (Action.PAUSE, Action.STEP, Action.CANCEL):
        assert is_enabled(panel.task.content, action)
    assert not is_enabled(panel.task.content, Action.GOAL)
    panel.show(replace(snapshot, mode=Mode.PAUSED))
    assert "Resume" in panel.task.content


def test_the_gallery_offers_images_of_nodes_as_goals(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = NavigationPanel(server.gui, nothing)
    panel.show(snapshot)
    assert snapshot.gallery
    for node in snapshot.gallery:
        assert f'src="/thumb/{node}.jpg" data-ltvn-action="select" data-id="{node}"' in panel.gallery.content


def test_panels_send_nothing_while_nothing_changes(
    server: viser.ViserServer, snapshot: Snapshot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = [
        StatusPanel(server.gui, clock=lambda: 0.0),
        DrivePanel(server.gui),
        FineTuningPanel(server.gui),
        NavigationPanel(server.gui, nothing),
        ReplayPanel(server.gui, nothing),
        CameraPanel(server.gui, nothing),
    ]
    for panel in panels:
        panel.show(snapshot)
    sent: list[Any] = []
    monkeypatch.setattr(server.gui._websock_interface, "queue_message", sent.append)
    for _ in range(10):
        for panel in panels:
            panel.show(snapshot)
    assert sent == []


def test_the_replay_tab_leaves_time_to_the_timeline(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = ReplayPanel(server.gui, nothing)
    replay = PlaybackStatus("a.rrd", 42.0, 21.0, playing=True)
    panel.show(replace(snapshot, mode=Mode.REPLAY, replay=replay, recordings=("a.rrd",)))
    assert controls(panel) == 1  # The list of recordings: no slider.
    assert "a.rrd: 21.0 of 42.0 s" in panel.about.content


def test_each_message_is_notified_once_to_every_page() -> None:
    told: list[str] = []

    def add_notification(title: str, body: str, **_: object) -> None:
        told.append(body)

    clients: Any = [SimpleNamespace(add_notification=add_notification)] * 2
    notices = Notifications(lambda: clients)
    for number in (1, 1, 2, 2):
        notices.show(Snapshot(message=Message("same words", Severity.INFO, number)))
    assert told == ["same words"] * 4


def test_camera_and_depth_are_shown_side_by_side_and_crisp() -> None:
    rgb = np.full((72, 96, 3), 200, np.uint8)
    depth = np.full((72, 96), 1.0, np.float32)
    picture = colour_beside_depth(CameraImage(rgb, depth))
    assert picture.shape == (240, 646, 3)
    np.testing.assert_array_equal(picture[120, 160], [200, 200, 200])


def test_near_is_lighter_than_far_and_no_return_is_black() -> None:
    near, far, none = depth_colours(np.array([[0.5, 4.0, 0.0]], np.float32))[0].astype(int)
    assert near.sum() > far.sum() > none.sum() == 0


def test_the_camera_is_sent_at_most_fifteen_times_a_second(server: viser.ViserServer) -> None:
    now = [0.0]
    panel = CameraPanel(server.gui, nothing, clock=lambda: now[0])
    views = [CameraImage(np.full((72, 96, 3), k, np.uint8), np.ones((72, 96), np.float32)) for k in range(30)]
    shown = []
    for view in views:
        now[0] += 1 / 30
        panel.show(Snapshot(camera=view))
        shown.append(panel.shown)
    assert 10 <= len({id(view) for view in shown}) <= 16


def test_gallery_images_lie_far_apart() -> None:
    poses = np.array([[0, 0, 0], [0.1, 0, 0], [5, 0, 0], [5.1, 0, 0], [0, 5, 0]], np.float64)
    rows = farthest_points(poses, 3)
    apart = np.linalg.norm(poses[rows][:, None, :2] - poses[rows][None, :, :2], axis=-1)
    assert apart[~np.eye(3, dtype=bool)].min() > 4


def test_thumbnails_are_bounded() -> None:
    thumbnails = ThumbnailStore()
    for frame in range(LIMIT + 10):
        thumbnails.put(frame, np.zeros((72, 96, 3), np.uint8))
    assert thumbnails.get(0) is None
    assert (thumbnails.get(LIMIT) or b"").startswith(b"\xff\xd8")


def test_a_part_that_fails_does_not_keep_the_others_from_drawing(
    server: viser.ViserServer, snapshot: Snapshot, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken:
        def show(self, snapshot: Snapshot) -> None:
            raise ValueError("no ink")

    status = StatusPanel(server.gui)
    Painter([Broken(), status], server.atomic).paint(snapshot)
    assert "driving" in status.line.content
    assert "Broken could not be drawn" in caplog.text
