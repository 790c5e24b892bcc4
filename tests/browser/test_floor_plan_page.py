"""A person lays the floor plan under the map by clicks, in a real headless Chromium."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.data.importing.floor_plan_alignment import align_floor_plan
from ltvn_core.geometry import compose, relative
from ltvn_core.types import Pose
from ltvn_viz.session.floor_plan_clicks import FloorPlanClicks
from ltvn_viz.session.snapshot import FloorPlanView
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import PRESSED_S, press, wait_for_rest
from tests.browser.flat_app import FlatApp, serving
from tests.browser.pages import is_bare_map, on_screen, open_page
from tests.core.data.importing.plan_files import laid_room
from tests.waiting import until

pytestmark = pytest.mark.browser

TRUE_FRAME = np.array([0.3, -0.2, 0.1])
"""Pose of the plan's frame in that of the map, which the person knows."""
CLICK_M = 0.15
"""Error of a click on the screen, in metres."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        app.harness.state.alignment = FloorPlanClicks(laid_room())
        yield app


def view_of(app: FlatApp) -> FloorPlanView:
    view = app.harness.now.floor_plan
    assert view is not None
    return view


def frame_of(app: FlatApp) -> Pose:
    """Return the pose of the plan's own frame as it is drawn."""
    return compose(view_of(app).plan.corner, relative(laid_room().plan.corner, np.zeros(3)))


def point_out(app: FlatApp, page: Page, row: int, *, pairs: int) -> None:
    """Click a node, and its place on the plan as it is drawn now."""
    graph = app.harness.now.moment.graph

    def place() -> Pose:
        """Return the place of the node that is chosen: several stand at one place and look in different directions."""
        pose = graph.poses[int(np.flatnonzero(graph.ids == view_of(app).node)[0])]
        return compose(frame_of(app), relative(TRUE_FRAME, pose))

    click(page, lambda: graph.poses[row], lambda: view_of(app).node is not None)
    expect(page.get_by_text(f"place of node {view_of(app).node}").first).to_be_visible()
    click(page, place, lambda: view_of(app).pairs == pairs)


def click(page: Page, at: Callable[[], Pose], took_effect: Callable[[], bool]) -> None:
    """Click a place of the map until the click takes effect: the page knows what it is for a moment after the app."""

    def again() -> None:
        point = on_screen(page, *at()[:2])
        assert is_bare_map(page, point)
        page.mouse.click(*point)
        with suppress(AssertionError):
            until(took_effect, patience_s=PRESSED_S)

    until(took_effect, meanwhile=again)


def test_three_clicks_on_nodes_and_three_on_the_plan_align_it(app: FlatApp, page: Page) -> None:
    wait_for_rest(app)
    page.get_by_role("tab", name="World").click()
    press(page, "Align by clicks", lambda: view_of(app).is_aligning)
    rows = apart(app.harness.now.moment.graph.poses)
    for number, row in enumerate(rows, 1):
        point_out(app, page, row, pairs=number)
    expect(page.get_by_text("The plan fits to").first).to_be_visible()
    press(page, "Use it", lambda: not view_of(app).is_aligning)

    np.testing.assert_allclose(frame_of(app)[:2], TRUE_FRAME[:2], atol=CLICK_M)
    told = page.locator("code", has_text="--align").inner_text()
    assert told == view_of(app).align
    graph = app.harness.now.moment.graph
    poses = dict(zip(map(int, graph.ids), graph.poses, strict=True))
    np.testing.assert_allclose(align_floor_plan(told.split()[1:], poses).pose, frame_of(app), atol=1e-9)
    assert app.session.state.activity.mode is Mode.TELEOP
    assert app.harness.state.queries == 0


def apart(poses: Pose) -> list[int]:
    """Return the rows of three nodes (N, 3) that are far from each other."""
    first = 0
    last = int(np.hypot(*(poses - poses[first])[:, :2].T).argmax())
    gaps = [np.hypot(*(poses - poses[row])[:, :2].T) for row in (first, last)]
    return [first, last, int(np.minimum(*gaps).argmax())]


def test_on_a_phone_the_tab_makes_room_for_the_clicks(app: FlatApp, chromium: Browser) -> None:
    with open_page(chromium, app.server.url, width=390, height=844, draws=False) as phone:
        phone.locator("#ltvn-nav").get_by_role("button", name="World").click()
        sheet = phone.get_by_role("button", name="close the panel")
        sheet.wait_for()
        press(phone, "Align by clicks", lambda: view_of(app).is_aligning)
        sheet.wait_for(state="hidden")
        phone.locator("#ltvn-nav").get_by_role("button", name="World").click()
        press(phone, "Cancel", lambda: not view_of(app).is_aligning)
