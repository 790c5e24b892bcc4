"""Panels against a real viser server without a browser."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser

from ltvn_core.navigation.events import Severity
from ltvn_viz.painter import Painter
from ltvn_viz.panels.camera_panel import CameraPanel
from ltvn_viz.panels.drive_panel import DrivePanel
from ltvn_viz.panels.fine_tuning_panel import FineTuningPanel
from ltvn_viz.panels.html_widgets import with_keys
from ltvn_viz.panels.legend_panel import LegendPanel
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.notifications import SECONDS, Notifications
from ltvn_viz.panels.pad_panel import PadPanel
from ltvn_viz.panels.replay_panel import ReplayPanel
from ltvn_viz.panels.status_panel import StatusPanel
from ltvn_viz.server.keymap import Action
from ltvn_viz.server.thumbnails import LIMIT, ThumbnailStore
from ltvn_viz.session.goals import farthest_points
from ltvn_viz.session.inspection import QuestionAnswer
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.overlay import Overlay
from ltvn_viz.session.snapshot import (
    JobProgress,
    Message,
    PlaybackStatus,
    RecordingStatus,
    Snapshot,
)
from tests.viz.panels.panel_contents import controls, is_enabled, nothing


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


def test_a_running_query_can_be_paused_stepped_and_cancelled(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = NavigationPanel(server.gui, nothing, "{}?key=k".format)
    panel.show(replace(snapshot, mode=Mode.NAVIGATING))
    for action in (Action.PAUSE, Action.STEP, Action.CANCEL):
        assert is_enabled(panel.task.content, action)
    assert not is_enabled(panel.task.content, Action.GOAL)
    panel.show(replace(snapshot, mode=Mode.PAUSED))
    assert "Resume" in panel.task.content


def test_the_gallery_offers_images_of_nodes_as_goals(server: viser.ViserServer, snapshot: Snapshot) -> None:
    panel = NavigationPanel(server.gui, nothing, "{}?key=k".format)
    panel.show(snapshot)
    assert snapshot.gallery
    for node in snapshot.gallery:
        assert f'src="/thumb/{node}.jpg?key=k" data-ltvn-action="select" data-id="{node}"' in panel.gallery.content


def test_panels_send_nothing_while_nothing_changes(
    server: viser.ViserServer, snapshot: Snapshot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = [
        StatusPanel(server.gui, clock=lambda: 0.0),
        DrivePanel(server.gui),
        FineTuningPanel(server.gui),
        NavigationPanel(server.gui, nothing, "{}?key=k".format),
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


def test_the_pad_hears_once_where_the_robot_drives_by_itself(snapshot: Snapshot) -> None:
    told: list[str] = []
    panel = PadPanel(told.append)
    under_way = replace(snapshot, mode=Mode.NAVIGATING, destination=snapshot.gallery[0])
    for shown in (snapshot, snapshot, under_way, replace(snapshot, story_goes_on=True), snapshot):
        panel.show(shown)
    assert [(said["mode"], said["goal"], said["story"]) for said in map(json.loads, told)] == [
        ("driving", None, False),
        ("navigating", snapshot.gallery[0], False),
        ("driving", None, True),
        ("driving", None, False),
    ]


def test_each_message_is_notified_once_to_every_page() -> None:
    told: list[str] = []

    def add_notification(title: str, body: str, **_: object) -> None:
        told.append(body)

    clients: Any = [SimpleNamespace(add_notification=add_notification)] * 2
    notices = Notifications(lambda: clients)
    for number in (1, 1, 2, 2):
        notices.show(Snapshot(message=Message("same words", Severity.INFO, number)))
    assert told == ["same words"] * 4


def test_what_is_said_before_a_page_is_open_is_notified_to_the_first_one() -> None:
    told: list[str] = []

    def add_notification(title: str, body: str, **_: object) -> None:
        told.append(body)

    clients: list[Any] = []
    notices = Notifications(lambda: clients)
    snapshot = Snapshot(message=Message("The scene lacks textures.", Severity.WARN, 1))
    notices.show(snapshot)
    clients.append(SimpleNamespace(add_notification=add_notification))
    notices.show(snapshot)
    notices.show(snapshot)
    assert told == ["The scene lacks textures."]


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
