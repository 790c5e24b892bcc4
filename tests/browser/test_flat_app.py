"""What a person sees and does on the page, in a real headless Chromium."""

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from ltvn_core.navigation.events import QueryStarted
from ltvn_core.types import NodeId
from ltvn_viz.panels.status_panel import PANEL_MARK
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import click_goal_image, hold_key, wait_for_rest
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.browser.pages import on_screen, open_page
from tests.waiting import until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        yield app


@pytest.fixture(scope="module")
def page(app: FlatApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


@pytest.fixture(autouse=True)
def idle(app: FlatApp, page: Page) -> None:
    """Begin at the robot, with nothing under way and nothing being recorded."""
    # Not by the key: what is sent through the page might come when the test has begun something.
    app.session.send(c.Ask(c.Action.CANCEL))
    until(lambda: app.session.state.activity.mode in (Mode.TELEOP, Mode.REPLAY))
    if app.session.state.activity.mode is Mode.REPLAY:
        app.session.send(c.Ask(c.Action.CLOSE))
    if app.harness.state.live.recorder.is_on:
        app.session.send(c.Ask(c.Action.DISCARD))
    wait_for_rest(app)
    until_shown(app, lambda now: now.mode is Mode.TELEOP and now.recording.name is None)


def drive(app: FlatApp, page: Page, key: str, holds: Callable[[Snapshot], bool]) -> None:
    """Hold a key until what the page is told to show fulfils something."""
    hold_key(app, page, key, lambda: holds(app.harness.now))


def open_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()


def farthest(app: FlatApp, goals: Sequence[NodeId]) -> NodeId:
    """Return the goal whose image was taken farthest from where the robot is, so that it has a way to go."""
    graph, here = app.harness.now.moment.graph, app.harness.robot.pose[:2]
    places = dict(zip(graph.ids.tolist(), graph.poses[:, :2], strict=True))
    return max(goals, key=lambda goal: float(np.linalg.norm(places[goal] - here)))


def set_out(app: FlatApp, page: Page) -> NodeId:
    """Send the robot to an image of the gallery that is far away, and return its node."""
    goal = click_goal_image(app, page, lambda offered: farthest(app, offered))
    until_shown(app, lambda now: now.mode is Mode.NAVIGATING)
    expect(pad(page)).to_contain_text(f"The robot drives to node {goal}. Hold W A S D")
    return goal


def pad(page: Page) -> Locator:
    """What the pad says of who drives."""
    return page.locator(".ltvn-pad .ltvn-status")


def test_a_first_time_visitor_sees_what_to_do(chromium: Browser, tmp_path: Path) -> None:
    with serving(tmp_path) as app, open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        expect(page).to_have_title("Lifelong Topological Visual Navigation")
        expect(page.get_by_text("Pick a goal")).to_be_visible()
        expect(page.get_by_role("tab", name="Go")).to_have_attribute("aria-selected", "true")
        before = app.harness.robot.pose.copy()
        hold_key(app, page, "d", lambda: bool((app.harness.robot.pose != before).any()))
        open_tab(page, "Drive")
        expect(page.get_by_role("button", name=re.compile("^Record"))).to_be_enabled()
        expect(page.get_by_role("button", name=re.compile("^Keep"))).to_be_disabled()


def test_a_page_that_waits_shows_at_what_the_app_is(chromium: Browser) -> None:
    with (
        GuardedServer(loading="Starting the simulator…") as server,
        open_page(chromium, server.url, width=1000, height=640, draws=False) as page,
    ):
        waiting = page.locator("#ltvn-loading")
        expect(waiting).to_contain_text("simulator")
        server.say_loading("Reading the map…")
        expect(waiting).to_contain_text("map")
        server.end_loading()
        expect(waiting).to_contain_text("scene")
        server.gui.add_html(PANEL_MARK)
        expect(waiting).to_be_hidden()


def test_the_status_line_shows_mode_and_health_and_the_numbers_behind_it_on_request(page: Page) -> None:
    status = page.locator(".lt-line")
    expect(status).to_contain_text("manual")
    health = status.locator(".lt-health")
    expect(health).to_have_text(re.compile("Good|Slow|Trouble"))
    expect(page.locator(".lt-numbers")).to_be_hidden()
    health.click()
    expect(page.locator(".lt-numbers")).to_contain_text(re.compile(r"\d+ times a second"))
    health.hover()
    page.mouse.down()
    health.evaluate("button => button.replaceWith(button.cloneNode(true))")  # As when the line is drawn anew.
    page.mouse.up()
    expect(page.locator(".lt-numbers")).to_be_hidden()


def test_a_gallery_image_sends_the_robot_there(app: FlatApp, page: Page) -> None:
    open_tab(page, "Go")
    pictures = page.locator(".lt-gallery img")
    expect(pictures.first).to_be_visible()
    pictures.first.evaluate("image => image.decode()")  # Raises for an image that did not come.
    goal = set_out(app, page)
    assert app.harness.now.selected == goal


def test_clicking_a_node_of_the_map_sends_the_robot_there(app: FlatApp, page: Page) -> None:
    graph = app.harness.now.moment.graph
    # A node by itself, away from the robot and from the window's edge, so that the click can mean only one.
    xy = graph.poses[:, :2]
    alone = np.sort(np.linalg.norm(xy[:, None] - xy[None], axis=-1), axis=1)[:, 1]
    alone[np.linalg.norm(xy - app.harness.robot.pose[:2], axis=1) < 0.7] = 0
    row = int(np.argmax(alone))
    page.mouse.click(*on_screen(page, *xy[row]))
    now = until_shown(app, lambda now: now.mode is Mode.NAVIGATING)
    assert now.moment.progress.goal is None or now.selected == int(graph.ids[row])


def test_pause_step_and_cancel_do_what_they_say(app: FlatApp, page: Page) -> None:
    open_tab(page, "Go")
    goal = set_out(app, page)
    page.get_by_role("button", name=re.compile("^Pause")).click()
    until_shown(app, lambda now: now.mode is Mode.PAUSED)
    expect(pad(page)).to_contain_text(f"The robot is paused on its path to node {goal}")
    where = app.harness.robot.step
    page.get_by_role("button", name=re.compile("^Step")).click()
    until_shown(app, lambda now: now.mode is Mode.PAUSED and app.harness.robot.step == where + 1)
    page.get_by_role("button", name=re.compile("^Cancel")).click()
    until_shown(app, lambda now: now.mode is Mode.TELEOP)
    expect(page.get_by_text("Last query: cancelled")).to_be_visible()


def test_driving_keys_take_over_from_navigation(app: FlatApp, page: Page) -> None:
    open_tab(page, "Go")
    set_out(app, page)
    drive(app, page, "a", lambda now: now.mode is Mode.TELEOP)
    expect(page.get_by_text("You took over").first).to_be_visible()
    expect(pad(page)).to_have_text("Hold W A S D or an arrow to drive")


def test_a_recording_is_made_kept_opened_and_sought(app: FlatApp, page: Page) -> None:
    open_tab(page, "Drive")
    page.get_by_role("button", name=re.compile("^Record")).click()
    until_shown(app, lambda now: now.recording.name is not None)
    drive(app, page, "d", lambda now: now.recording.frames > 8)
    page.get_by_role("button", name=re.compile("^Keep")).click()
    until_shown(app, lambda now: now.recording.name is None and bool(now.recordings))
    open_tab(page, "Replay")
    page.get_by_role("button", name="Open", exact=True).click()
    now = until_shown(app, lambda now: now.mode is Mode.REPLAY)
    assert now.replay is not None
    expect(pad(page)).to_have_text("This is a recording; the robot is stopped")
    slider = page.get_by_role("slider", name="moment on show")
    slider.focus()
    slider.press("End")
    now = until_shown(app, lambda now: now.timeline.is_replay and now.timeline.time_s > 0.2)
    assert now.moment.frames > 1
    slider.press("Home")
    until_shown(app, lambda now: now.timeline.is_replay and now.timeline.time_s == 0)
    box = slider.bounding_box()
    assert box is not None
    slider.click(position={"x": box["width"] - 3, "y": box["height"] / 2})  # A hand hardly hits the last pixel.
    until_shown(app, lambda now: now.timeline.is_replay and abs(now.timeline.time_s - now.timeline.length_s) < 0.001)
    slider.press("Home")
    until_shown(app, lambda now: now.timeline.is_replay and now.timeline.time_s == 0)
    page.get_by_role("button", name="play", exact=True).click()
    until_shown(app, lambda now: now.timeline.is_replay and now.timeline.time_s > 0.2)
    page.get_by_role("button", name="Back to the robot").click()
    until_shown(app, lambda now: now.mode is Mode.TELEOP)


def test_a_cut_connection_and_a_reload_leave_the_tab_open_that_was_open(app: FlatApp, chromium: Browser) -> None:
    # A page of its own, because viser connects again only while its window has the focus.
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        open_tab(page, "World")
        page.evaluate("document.querySelector('[role=tablist]').dataset.cut = ''")

        app.server.viser._websock_server.disconnect_all_clients()

        expect(page.locator("[role=tablist]:not([data-cut])")).to_be_visible()
        expect(page.get_by_role("tab", name="World")).to_have_attribute("aria-selected", "true")
        page.reload()
        expect(page.get_by_role("tab", name="World")).to_have_attribute("aria-selected", "true")


def test_a_refused_command_says_what_to_do_first(app: FlatApp, page: Page) -> None:
    page.keyboard.press("p")
    expect(page.get_by_role("alert").filter(has_text="Choose a goal").first).to_be_visible()


def test_what_the_robot_sees_is_drawn_pixel_for_pixel_and_larger_without_a_blur(app: FlatApp, page: Page) -> None:
    seen = until_shown(app, lambda now: now.camera is not None).camera
    assert seen is not None
    for id_ in ("ltvn-colour", "ltvn-depth"):
        drawn = page.locator(f"#{id_}")
        expect(drawn).to_have_js_property("width", seen.rgb.shape[1])
        expect(drawn).to_have_js_property("height", seen.rgb.shape[0])
        expect(drawn).to_have_css("image-rendering", "pixelated")


def upload(page: Page, file: Path) -> None:
    """Upload a file as a person does."""
    open_tab(page, "Go")
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Go to an uploaded image").click()
    chooser.value.set_files(file)


def shows_no_success_of_its_own(page: Page) -> None:
    """Check that nothing is said of a file that has come but may hold no image."""
    viser_s_own = page.locator(".mantine-Notification-root", has_text="uploaded successfully")
    expect(viser_s_own.locator("visible=true")).to_have_count(0)


def test_an_uploaded_image_finds_its_place(app: FlatApp, page: Page, tmp_path: Path) -> None:
    node = farthest(app, app.harness.now.gallery)
    picture = tmp_path / "goal.jpg"
    picture.write_bytes(app.harness.state.goals.thumbnails.get(node) or b"")
    events = app.harness.state.live.timeline.events
    before = len(events)
    upload(page, picture)
    expect(page.get_by_text("Going to the place").first).to_be_visible()
    shows_no_success_of_its_own(page)
    match = page.locator(".lt-upload")
    own = match.get_by_alt_text("your image")
    # Not `wait_for_function`, which evaluates text in the page, as its policy forbids.
    until(
        lambda: page.evaluate("[...document.querySelectorAll('.lt-upload img')].every((each) => each.naturalWidth > 0)")
    )
    places = match.get_by_role("group").locator("figure")
    best = places.first
    found = app.harness.now.upload
    assert found is not None
    goal = found.places[0].node
    until(lambda: goal in [each.event.goal for each in events[before:] if isinstance(each.event, QueryStarted)])
    expect(best).to_contain_text(f"node {found.places[0].node}")
    expect(best).to_contain_text(f"{found.places[0].likeness:.2f}")

    def are_side_by_side() -> bool:
        left, right = own.bounding_box(), best.bounding_box()
        return left is not None and right is not None and left["x"] + left["width"] <= right["x"]

    until(are_side_by_side)


def test_an_upload_that_is_no_image_is_a_clear_error(app: FlatApp, page: Page, tmp_path: Path) -> None:
    evil = tmp_path / "<b>evil.jpg"
    evil.write_bytes(b"not a picture")
    upload(page, evil)
    expect(page.get_by_role("alert").filter(has_text="<b>evil.jpg").first).to_be_visible()
    shows_no_success_of_its_own(page)
    expect(page.locator(".lt-health:visible")).not_to_have_text("Trouble")  # The app itself is well.
    assert app.session.state.activity.mode is Mode.TELEOP


_CONNECT_LATE = """
const post = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (message, ...more) {
  const go = () => post.call(this, message, ...more);
  if (message?.type === "connect") window.letConnect = go;
  else go();
};
"""


def test_a_click_before_the_connection_stands_is_not_lost(chromium: Browser, tmp_path: Path) -> None:
    with serving(tmp_path) as app, chromium.new_context(viewport={"width": 1000, "height": 640}) as context:
        context.add_init_script(_CONNECT_LATE)
        page = context.new_page()
        page.goto(app.server.url)
        page.get_by_text("Next:").wait_for()
        page.evaluate("document.documentElement.dataset.ltvnReady = ''")
        page.get_by_role("button", name=re.compile("^Record")).click()
        page.evaluate("window.letConnect()")
        until_shown(app, lambda now: now.recording.name is not None)
