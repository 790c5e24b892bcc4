"""The app as `ltvn app` opens it, in the demo apartment, with the simulator's own geometry instead of the network."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import press, wait_for_built_map
from tests.browser.pages import open_page, wait_for_scene
from tests.browser.running_app import running_app
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    folder = tmp_path_factory.mktemp("recordings")
    options = AppOptions(port=0, predictor="oracle", recordings=folder)
    with running_app(options, lease_s=5.0) as app:
        yield app


@pytest.fixture
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=900, height=560, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


def test_the_apartment_is_drawn(app: RunningApp, chromium: Browser) -> None:
    with open_page(chromium, app.server.url, width=900, height=560, scene=True) as page:
        page.get_by_text("Next:").wait_for()
        client = wait_for_scene(app.server.viser)
        drawn = client.get_render(120, 160, timeout=PATIENCE_S)[..., :3]
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 500


def count(page: Page, what: str) -> int:
    """Read a number of the Drive tab."""
    cell = page.locator(".lt-table div", has_text=re.compile(rf"\d{what}$"))
    return int(cell.locator("b").inner_text().replace(",", ""))


def test_one_drives_the_map_grows_and_is_built_anew_and_the_recording_is_watched(app: RunningApp, page: Page) -> None:
    expect(page.get_by_text("Hold W A S D or the arrow keys")).to_be_visible()
    expect(page.get_by_role("tab", name="Drive")).to_have_attribute("aria-selected", "true")
    press(page, "Record", page.locator("#ltvn-rec .lt-rec").is_visible)

    def turn_on() -> None:
        page.keyboard.down("d")
        page.wait_for_timeout(1500)
        page.keyboard.up("d")

    until(lambda: count(page, "nodes") >= 3, meanwhile=turn_on)
    page.get_by_role("button", name=re.compile("^Rebuild")).click()
    wait_for_built_map(app)
    assert app.session.state.live_map.graph.nodes
    page.get_by_role("button", name=re.compile("^Keep")).click()
    expect(page.get_by_text("Kept as").first).to_be_visible()
    page.get_by_role("tab", name="Replay").click()
    page.get_by_role("button", name="Open", exact=True).click()
    until(lambda: app.session.state.activity.mode is Mode.REPLAY)
    timeline, whole = page.get_by_label("moment on show"), page.get_by_text(re.compile(r"\d\d images, \d+ nodes"))

    def to_the_end() -> None:
        timeline.press("End")
        page.wait_for_timeout(300)

    until(whole.is_visible, meanwhile=to_the_end)
    page.get_by_role("button", name="Back to the robot").click()
    until(lambda: app.session.state.activity.mode is Mode.TELEOP)


def test_a_page_says_large_that_the_app_is_frozen_or_has_ended_which_a_polite_kill_does_in_order(
    tmp_path: Path, chromium: Browser
) -> None:
    program = Path(sys.executable).with_name("ltvn")
    command = [str(program), "app", "--port", "0", "--predictor", "oracle"]
    process = subprocess.Popen(
        [*command, "--recordings", str(tmp_path)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    )
    assert process.stderr is not None
    lines = iter(process.stderr)
    said = next(line for line in lines if "http://127.0.0.1" in line)
    assert "token=" in said
    assert any("Ready." in line for line in lines)
    link = re.search(r"http://\S+", said)
    assert link is not None
    with open_page(chromium, link[0], width=900, height=560, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        alert = page.get_by_role("alert").filter(has_text="app")
        expect(alert).to_have_count(0)
        process.send_signal(signal.SIGSTOP)
        expect(alert).to_contain_text("does not answer")
        process.send_signal(signal.SIGCONT)
        expect(alert).to_have_count(0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 0
        expect(alert).to_contain_text("connection")
    process.stderr.close()
