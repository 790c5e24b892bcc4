"""Change the world, in a real browser: two rooms with two doors, of which the map knows one."""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.data.recording.reader import Recording
from ltvn_core.navigation.events import ChangedBy, WorldChanged
from ltvn_core.worlds import DoorMoved, LightChanged, ThingPlaced, ThingRemoved, WorldChange
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.snapshot import BoxView, WorldView
from tests.browser.pages import on_screen, open_page
from tests.browser.running_app import running_app
from tests.core.plugin_packages import install
from tests.core.simulation.two_door_scene import NAME, write_map
from tests.waiting import until

pytest.importorskip("embreex")
pytestmark = pytest.mark.browser

SOURCE = "from tests.core.simulation.two_door_scene import two_door_scene\n"
HERE, THERE = (1.4, 2.3), (3.6, 3.1)
"""Free floor in the one room and in the other that nothing on the page covers, in metres."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    folder = tmp_path_factory.mktemp("two_doors")
    install(folder, "two_door_house", f"[ltvn.scenes]\n{NAME} = two_door_house:two_door_scene\n", source=SOURCE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        write_map(folder / "map.rrd")
        options = AppOptions(port=0, predictor="oracle", map=folder / "map.rrd", recordings=folder / "recordings")
        with running_app(options) as app:
            yield app


@pytest.fixture(scope="module")
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1280, height=800, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


@pytest.fixture(autouse=True)
def world_tab(page: Page) -> None:
    page.get_by_role("tab", name="World").click()


def view(app: RunningApp) -> WorldView:
    world = app.session.state.world
    assert world is not None
    return world.view


def press(page: Page, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).click()


def click_map(page: Page, x: float, y: float) -> None:
    page.mouse.click(*on_screen(page, x, y))


def recorded_changes(app: RunningApp) -> list[WorldChange]:
    (path,) = app.session.state.library.folder.glob("*.rrd")
    events = (stamped.event for stamped in Recording.open(path).events)
    changes = [event for event in events if isinstance(event, WorldChanged)]
    assert {each.by for each in changes} <= {ChangedBy.HAND, ChangedBy.SCRIPT}
    return [each.change for each in changes]


def box_near(app: RunningApp, place: tuple[float, float]) -> BoxView | None:
    """Return the box at a place: a click hits the floor to a few centimetres."""
    return next((each for each in view(app).boxes if np.hypot(each.x - place[0], each.y - place[1]) < 0.15), None)


def test_what_a_person_changes_in_the_page_is_in_the_recording(app: RunningApp, page: Page) -> None:
    page.get_by_role("tab", name="Drive").click()
    page.get_by_role("button", name=re.compile("^Record")).click()
    expect(page.locator("#ltvn-rec .lt-rec")).to_be_visible()
    page.get_by_role("tab", name="World").click()
    door = view(app).doors[1]
    click_map(page, door.x, door.y)
    until(lambda: not view(app).doors[1].is_open)
    page.get_by_role("button", name=f"{door.label}: closed", exact=True).last.click()
    until(lambda: view(app).doors[1].is_open)

    press(page, "Put a box on the floor")
    page.get_by_text("Click the floor").wait_for()
    click_map(page, *HERE)
    until(lambda: box_near(app, HERE), explain=lambda: view(app))
    box = view(app).boxes[0]
    page.get_by_role("button", name="Move box 1").wait_for()

    def take_up() -> None:  # The browser may draw the box later than its buttons.
        click_map(page, box.x, box.y)
        page.wait_for_timeout(1000)

    until(lambda: view(app).aimed == 1, meanwhile=take_up)
    page.get_by_text("Click the floor").wait_for()
    click_map(page, *THERE)
    until(lambda: box_near(app, THERE), explain=lambda: view(app))
    assert len(view(app).boxes) == 1
    press(page, "Take away box 1")
    until(lambda: not view(app).boxes)
    press(page, "Dim")
    until(lambda: view(app).light == 0.5)
    press(page, "Undo: light at 50%")
    until(lambda: view(app).light == 1.0)

    page.get_by_role("tab", name="Drive").click()
    page.get_by_role("button", name=re.compile("^Keep")).click()
    expect(page.get_by_text("Kept as").first).to_be_visible()
    kinds = [type(each) for each in recorded_changes(app)]
    assert kinds == [DoorMoved, DoorMoved, ThingPlaced, ThingPlaced, ThingRemoved, LightChanged, LightChanged]


def test_the_story_names_the_command_that_opens_its_own_map(page: Page) -> None:
    expect(page.get_by_role("button", name="Watch it learn")).to_be_disabled()
    expect(page.get_by_role("tabpanel")).to_contain_text("ltvn app")
