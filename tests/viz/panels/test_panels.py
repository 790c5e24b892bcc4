"""Panels against a real viser server without a browser."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import viser

from ltvn_core.navigation.events import Outcome, QueryEnded, Severity
from ltvn_viz.page_layout import Painter
from ltvn_viz.panels.camera_panel import CameraPanel
from ltvn_viz.panels.drive_panel import DrivePanel, FineTuningPanel, PadPanel
from ltvn_viz.panels.floor_plan_panel import FloorPlanPanel
from ltvn_viz.panels.html_widgets import with_keys
from ltvn_viz.panels.navigation_panel import NavigationPanel
from ltvn_viz.panels.replay_panel import ReplayPanel
from ltvn_viz.panels.status_panel import AFTERWARDS_S, SECONDS, TITLES, Notifications, StatusPanel, StoryBar, first_tab
from ltvn_viz.panels.world_panel import WorldPanel
from ltvn_viz.session import snapshot as s
from ltvn_viz.session.goals import LIMIT, ThumbnailStore, farthest_points
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.session.snapshot_builder import hint
from ltvn_viz.wishes.commands import Action
from ltvn_viz.wishes.modes import Mode
from tests.core.data.importing.plan_files import laid_room
from tests.viz.panels.panel_contents import is_enabled, nothing


@pytest.mark.parametrize(
    ("snapshot", "tab"),
    [
        (s.Snapshot(hint="Hold W A S D to drive on through the doors."), 'tab="Drive"'),
        (s.Snapshot(hint="Pick an image under “Go”, or ask under “Why”."), 'tab="Go"'),
        (s.Snapshot(hint="Press “Back” under “Replay”.", mode=Mode.REPLAY), 'tab="Replay"'),
        (
            s.Snapshot(hint="It ends under “Replay”.", mode=Mode.REPLAY, inspection=Inspection(QuestionName.EDGE)),
            'tab="Why"',
        ),
        (s.Snapshot(hint="Drive.", work=s.JobProgress("Opening")), ""),
    ],
)
def test_a_page_opens_with_the_tab_that_its_first_hint_names(snapshot: s.Snapshot, tab: str) -> None:
    assert first_tab(snapshot).endswith(tab)
    assert bool(tab) == bool(first_tab(snapshot))


def test_html_in_messages_and_names_is_shown_as_text(gui: viser.GuiApi) -> None:
    evil = "<img src=x onerror=alert(1)>"
    now = [0.0]
    status = StatusPanel(gui, clock=lambda: now[0])
    status.show(s.Snapshot(hint=evil, message=s.Message(evil, Severity.ERROR, 1)))
    now[0] += SECONDS[Severity.ERROR] + 1
    status.show(s.Snapshot(hint=evil, message=s.Message(evil, Severity.ERROR, 1)))
    replay = ReplayPanel(gui)
    replay.show(s.Snapshot(mode=Mode.REPLAY, replay=evil, recordings={evil: ""}))
    for markup in (status.hint, status.message, replay.about):
        assert "<img" not in markup.content
        assert "&lt;img" in markup.content


def test_a_sentence_with_several_keys_names_none_of_them_to_a_finger() -> None:
    shown = with_keys("Take over with W A S D, stop with Space.")
    to_a_finger = re.sub(r'<span class="ltvn-by-key">.*?</span>', "", shown)
    assert re.sub("<.*?>", "", to_a_finger) == "Take over with an arrow, stop with Stop."


def test_the_status_line_says_mode_health_and_what_is_recorded_and_has_the_numbers_at_hand(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    status = StatusPanel(gui)
    rates = replace(snapshot.rates, loop_hz=29.7, frame_age_ms=41.0, dropped=7)
    status.show(replace(snapshot, rates=rates, recording=s.RecordingStatus("a.rrd", 12, 3.0)))
    line = status.line.content
    parts = ("manual", ">Good<", "12 images", "30 times a second", "41 ms", ">7<", "REC 0:03", 'data-ltvn-copy="rec"')
    for part in parts:
        assert part in line
    status.show(snapshot)
    assert "REC" not in status.line.content


def test_numbers_are_refreshed_twice_a_second_but_the_mode_at_once(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    status = StatusPanel(gui, clock=lambda: 0.0)
    status.show(snapshot)
    first = status.line.content
    status.show(replace(snapshot, rates=replace(snapshot.rates, loop_hz=3.0)))
    assert status.line.content == first
    status.show(replace(snapshot, mode=Mode.PAUSED))
    assert "paused" in status.line.content


def test_a_message_is_never_in_the_panel_while_its_notification_says_it(gui: viser.GuiApi) -> None:
    now = [0.0]
    status = StatusPanel(gui, clock=lambda: now[0])
    for severity in Severity:
        told = s.Snapshot(message=s.Message("a word", severity, 1))
        status.show(replace(told, message=None))
        status.show(told)
        assert status.message.content == ""
        now[0] += SECONDS[severity] + 1
        status.show(told)
        assert ("a word" in status.message.content) == (severity is Severity.ERROR)


def test_work_is_shown_with_what_is_done_of_how_much(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    status = StatusPanel(gui)
    status.show(replace(snapshot, work=s.JobProgress("Building the map", 840, 2000)))
    assert "Building the map… 840 of 2,000 images, 42 %" in status.hint.content
    assert 'aria-valuenow="42"' in status.hint.content
    status.show(replace(snapshot, work=s.JobProgress("Importing a.mp4", 840)))
    assert "Importing a.mp4… 840 images so far" in status.hint.content


def test_recording_buttons_follow_what_makes_sense(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    panel = DrivePanel(gui)
    panel.show(snapshot)
    html = panel.recording.content
    assert is_enabled(html, Action.RECORD)
    assert not is_enabled(html, Action.KEEP)
    panel.show(replace(snapshot, recording=s.RecordingStatus("a.rrd", 1, 0.1)))
    html = panel.recording.content
    assert not is_enabled(html, Action.RECORD)
    assert is_enabled(html, Action.KEEP)
    assert is_enabled(html, Action.DISCARD)


def test_building_a_map_can_be_cancelled_where_it_was_begun(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    panel = DrivePanel(gui)
    panel.show(replace(snapshot, mode=Mode.BUILDING))
    assert is_enabled(panel.map.content, Action.CANCEL)
    panel.show(snapshot)
    assert Action.CANCEL not in panel.map.content


def test_a_running_query_can_be_paused_stepped_and_cancelled(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    panel = NavigationPanel(gui, nothing, "{}?key=k".format)
    panel.show(replace(snapshot, mode=Mode.NAVIGATING))
    for action in (Action.PAUSE, Action.STEP, Action.CANCEL):
        assert is_enabled(panel.task.content + panel.more.content, action)
    assert not is_enabled(panel.task.content, Action.GOAL)
    panel.show(replace(snapshot, mode=Mode.PAUSED))
    assert "Resume" in panel.task.content


def test_the_gallery_offers_images_of_nodes_as_goals(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    panel = NavigationPanel(gui, nothing, "{}?key=k".format)
    panel.show(snapshot)
    assert snapshot.gallery
    for node in snapshot.gallery:
        assert f'src="/thumb/{node}.jpg?key=k" data-ltvn-action="select" data-id="{node}"' in panel.gallery.content


def test_on_the_way_three_images_say_where_it_is_what_comes_next_and_where_it_goes(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    panel = NavigationPanel(gui, nothing, "{}?key=k".format)
    panel.show(snapshot)
    assert "<img" not in panel.way.content
    panel.show(replace(snapshot, way=s.WayNodes(3, 5, 9)))
    assert re.findall(r"/thumb/(\d+)\.jpg", panel.way.content) == ["3", "5", "9"]
    panel.show(replace(snapshot, way=s.WayNodes(None, None, 9)))
    assert re.findall(r"/thumb/(\d+)\.jpg", panel.way.content) == ["9"]


def test_a_goal_chosen_while_a_query_runs_is_named_as_the_next_one(gui: viser.GuiApi, snapshot: s.Snapshot) -> None:
    panel = NavigationPanel(gui, nothing, "{}?key=k".format)
    ended = QueryEnded(query=4, goal=7, outcome=Outcome.CANCELLED, steps=1, collisions=0, path_m=0.0)
    still = snapshot.moment.progress
    for progress in (still._replace(query=4, goal=7), still._replace(query=None, ended=ended)):
        there = replace(snapshot, moment=replace(snapshot.moment, progress=progress), way=s.WayNodes(3, 5, 7))
        panel.show(replace(there, selected=7))
        assert "node 12" not in panel.state.content
        panel.show(replace(there, selected=12))
        assert "goal: node 12" in panel.state.content


def test_an_upload_stands_under_its_heading_beside_places_with_their_likeness(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    panel = NavigationPanel(gui, nothing, "{}?key=k".format)
    panel.show(snapshot)
    assert panel.upload_match.content == ""
    places = (s.LikePlace(17, 0.913), s.LikePlace(4, -0.2))
    panel.show(replace(snapshot, upload=s.UploadMatch("data:image/jpeg;base64,AA==", places)))
    shown = panel.upload_match.content
    assert shown.count("<h2>") == 2
    assert 'src="data:image/jpeg;base64,AA=="' in shown
    assert re.findall(r"node (\d+), likeness (-?\d\.\d\d)<", shown) == [("17", "0.91"), ("4", "-0.20")]


def test_panels_send_nothing_while_nothing_changes(
    gui: viser.GuiApi, snapshot: s.Snapshot, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = [
        StatusPanel(gui, clock=lambda: 0.0),
        DrivePanel(gui),
        FineTuningPanel(gui),
        NavigationPanel(gui, nothing, "{}?key=k".format),
        ReplayPanel(gui),
        CameraPanel(gui, nothing, nothing),
    ]
    for panel in panels:
        panel.show(snapshot)
    sent: list[Any] = []
    monkeypatch.setattr(gui._websock_interface, "queue_message", sent.append)
    for _ in range(10):
        for panel in panels:
            panel.show(snapshot)
    assert sent == []


def test_of_a_recording_that_is_chosen_one_sees_when_it_was_written_and_how_large_it_is(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    panel = ReplayPanel(gui)
    panel.show(replace(snapshot, recordings={"a.rrd": "2026-11-25 21:30, 3.1 MB"}))
    assert "21:30, 3.1 MB" in panel.about.content


def test_the_pad_hears_once_where_the_robot_drives_by_itself(snapshot: s.Snapshot) -> None:
    told: list[str] = []
    panel = PadPanel(told.append)
    under_way = replace(snapshot, mode=Mode.NAVIGATING, destination=snapshot.gallery[0])
    for shown in (snapshot, snapshot, under_way, replace(snapshot, story_goes_on=True), snapshot):
        panel.show(shown)
    assert [(said["mode"], said["goal"], said["story"]) for said in map(json.loads, told)] == [
        ("manual", None, False),
        ("navigating", snapshot.gallery[0], False),
        ("manual", None, True),
        ("manual", None, False),
    ]


Told = list[tuple[str, str]]


def pages(count: int) -> tuple[Told, list[Any]]:
    """Return so many pages, and the titles and words of which they are notified."""
    told: Told = []
    page = SimpleNamespace(add_notification=lambda title, body, **_: told.append((title, body)))
    return told, [page] * count


def test_each_message_is_notified_once_to_every_page() -> None:
    told, clients = pages(2)
    notices = Notifications(lambda: clients)
    for number in (1, 1, 2, 2):
        notices.show(s.Snapshot(message=s.Message("same words", Severity.INFO, number)))
    assert [words for _, words in told] == ["same words"] * 4


def test_a_message_has_its_own_title_or_that_of_how_grave_it_is() -> None:
    told, clients = pages(1)
    notices = Notifications(lambda: clients)
    notices.show(s.Snapshot(message=s.Message("words", Severity.WARN, 1, "Image not found in the map")))
    notices.show(s.Snapshot(message=s.Message("words", Severity.WARN, 2)))
    assert [title for title, _ in told] == ["Image not found in the map", TITLES[Severity.WARN]]


def test_what_is_said_before_a_page_is_open_is_notified_to_the_first_one() -> None:
    told, opened = pages(1)
    clients: list[Any] = []
    notices = Notifications(lambda: clients)
    snapshot = s.Snapshot(message=s.Message("The scene lacks textures.", Severity.WARN, 1))
    notices.show(snapshot)
    clients += opened
    notices.show(snapshot)
    notices.show(snapshot)
    assert [words for _, words in told] == ["The scene lacks textures."]


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
    server: viser.ViserServer, snapshot: s.Snapshot, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken:
        def show(self, snapshot: s.Snapshot) -> None:
            raise ValueError("no ink")

    class Told:
        def show(self, snapshot: s.Snapshot) -> None:
            told.append(snapshot.message)

    told: list[s.Message | None] = []
    status = StatusPanel(server.gui)
    painter = Painter(server.atomic)
    painter.parts = [Broken(), status, Told()]
    painter.paint(snapshot)
    painter.paint(snapshot)
    assert "manual" in status.line.content
    assert told[1] is not None
    assert "Broken" in told[1].text
    assert "Broken could not be drawn" in caplog.text


def test_a_story_has_one_caption_at_a_time_and_its_end_stays_for_a_while(gui: viser.GuiApi) -> None:
    now = [0.0]
    bar = StoryBar(gui, lambda: now[0])
    bar.show(s.Snapshot(story=("The <door> closes.", "The plan changes."), story_goes_on=True))
    assert "The plan changes." in bar.caption.content
    assert "closes" not in bar.caption.content
    bar.show(s.Snapshot(story=("The <door> is open.",), story_goes_on=True))
    assert "&lt;door&gt;" in bar.caption.content
    now[0] += AFTERWARDS_S + 1
    bar.show(s.Snapshot(story=("The <door> is open.",)))
    assert "door" not in bar.caption.content
    over = s.Snapshot(story=("The story is over.",))
    bar.show(over)
    assert "over" in bar.caption.content


def test_while_a_story_goes_on_nobody_is_told_to_pick_a_goal_or_can_begin_another(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    world = s.WorldView((s.DoorView(0, "hall", 1, 1, along_x=True, width_m=1),), (), None, 1.0, "")
    panel = WorldPanel(gui)
    snapshot = replace(snapshot, no_story="")
    panel.show(replace(snapshot, world=world))
    assert is_enabled(panel.watch.content, Action.WATCH_IT_LEARN)
    told = replace(snapshot, world=world, story=("It begins.",), story_goes_on=True)
    panel.show(told)
    assert not is_enabled(panel.watch.content, Action.WATCH_IT_LEARN)
    for mode in (Mode.TELEOP, Mode.NAVIGATING):
        assert "story" in hint(replace(told, mode=mode))
    ended = QueryEnded(query=4, goal=7, outcome=Outcome.CANCELLED, steps=1, collisions=0, path_m=0.0)
    progress = snapshot.moment.progress._replace(ended=ended)
    over = replace(told, story_goes_on=False, story_query=4, moment=replace(snapshot.moment, progress=progress))
    assert "story is over" in hint(over)
    assert "story" not in hint(replace(over, story_query=3))


def test_the_floor_plan_offers_the_next_step_and_afterwards_the_option_to_copy(
    gui: viser.GuiApi, snapshot: s.Snapshot
) -> None:
    panel = FloorPlanPanel(gui)
    panel.show(snapshot)
    assert not panel.buttons.content, "there is no floor plan"
    view = s.FloorPlanView(laid_room().plan)
    panel.show(replace(snapshot, floor_plan=view))
    assert is_enabled(panel.buttons.content, Action.ALIGN_PLAN)
    one = replace(view, is_aligning=True, pairs=1, marks=((0.0, 0.0), (1.0, 0.0)))
    panel.show(replace(snapshot, floor_plan=one))
    assert is_enabled(panel.buttons.content, Action.UNDO_PLAN_CLICK)
    assert not is_enabled(panel.buttons.content, Action.USE_ALIGNMENT)
    panel.show(replace(snapshot, floor_plan=replace(one, pairs=2, error_m=0.7)))
    assert is_enabled(panel.buttons.content, Action.USE_ALIGNMENT)
    assert "0.70 m" in panel.about.content
    assert "WARN" in panel.about.content
    panel.show(replace(snapshot, floor_plan=replace(view, align="--align 1=0,0 2=3,0")))
    assert 'data-ltvn-copy-text="--align 1=0,0 2=3,0"' in panel.about.content
