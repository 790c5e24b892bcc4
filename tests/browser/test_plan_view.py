"""The map from above, on the demo's map: whatever one points at is taken by the first click, touch or tap."""

import io
import math
import os
import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, CDPSession, Page, expect

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes import commands as c
from tests.browser.actions import wait_for_rest
from tests.browser.pages import PLAN, draw_nothing, on_screen, wait_until_drawn
from tests.browser.plan_hands import NOTE_ASKED, Asked, PlanHands
from tests.browser.running_app import running_app
from tests.repository import DEMO_MAP
from tests.waiting import PATIENCE_MS, until

pytestmark = [pytest.mark.browser, pytest.mark.slow]

MAP = Path(os.environ.get("LTVN_PLAN_MAP", DEMO_MAP))
"""The variable names another map, such as that of a larger house, for the tests of nodes and edges."""
COUNT = 50
TOUCHED = 8
FAR_PX = 18.0
SEED = 7
COUNT_STROKES = """
window.strokes = 0;
for (const name of ["stroke", "fill", "drawImage", "clearRect"]) {
  const call = CanvasRenderingContext2D.prototype[name];
  CanvasRenderingContext2D.prototype[name] = function (...values) {
    if (!this.canvas.closest("#ltvn-pictures, #timeline-dock")) window.strokes++;
    return call.apply(this, values);
  };
}
"""
"""All drawing of the page, except the robot's pictures and the timeline, which go on with the time."""
REST_MS = 3000


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    options = AppOptions(port=0, map=MAP, recordings=tmp_path_factory.mktemp("recordings"), seed=1)
    with running_app(options) as app:
        yield app


@pytest.fixture(scope="module")
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    window = chromium.new_context(viewport={"width": 1280, "height": 800}, has_touch=True)
    draw_nothing(window, every_ms=30)
    window.add_init_script(NOTE_ASKED)
    page = window.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(app.server.url)
    page.get_by_text("Next:").wait_for()
    wait_until_drawn(page)
    yield page
    window.close()


@pytest.fixture
def hands(app: RunningApp, page: Page) -> PlanHands:
    """A page that shows the whole floor and asks nothing; the last tap of the test before may still be on its way."""

    def asks_nothing() -> bool:
        app.session.send(c.Ask(c.Action.QUESTION, QuestionName.FIRST))
        return not app.session.state.debugger.is_on

    until(asks_nothing)
    hands = PlanHands(app, page)
    hands.show_whole()
    return hands


def ask_by_hand(app: RunningApp) -> None:
    """Open the question to which every click on a node or an edge is an answer."""
    app.session.send(c.Ask(c.Action.QUESTION, QuestionName.HAND))
    until(lambda: app.session.state.debugger.is_on)


def selected_node(app: RunningApp) -> NodeId | None:
    return app.session.state.debugger.shown.selection.node


def selected_edge(app: RunningApp) -> EdgeKey | None:
    return app.session.state.debugger.shown.selection.edge


def test_any_node_is_taken_by_the_first_click_and_by_a_finger(app: RunningApp, hands: PlanHands) -> None:
    """A finger takes at once what stands alone; what shares a place with others, at the second tap."""
    ask_by_hand(app)
    for node in random.Random(SEED).sample(sorted(hands.poses), COUNT):
        hands.look_at_node(node)
        points = hands.points_of_node(node)
        point = hands.point_at(f"node {node}", points)
        hands.take(point, lambda node=node: selected_node(app) == node)
        asked = hands.tap(["pick", node], points[0], point)
        if asked is None and hands.is_crowded(node):
            asked = hands.tap_among(f"node {node}", points)
        assert asked == ["pick", node], f"node {node}: {asked}"


def test_any_edge_is_taken_by_the_first_click_and_by_a_finger(app: RunningApp, hands: PlanHands) -> None:
    ask_by_hand(app)
    for edge in random.Random(SEED).sample(hands.edges, COUNT):
        point, points = hands.find_edge(edge)
        hands.take(point, lambda edge=edge: selected_edge(app) == edge)
        asked = hands.tap(["pick_edge", list(edge)], *hands.places_to_tap(points), point) or hands.tap_among(
            f"edge {edge[0]},{edge[1]}", points
        )
        assert asked == ["pick_edge", list(edge)], f"edge {edge}: {asked}"


def test_a_finger_beside_a_node_that_stands_alone_takes_it(app: RunningApp, hands: PlanHands) -> None:
    """A mouse so far away points at nothing."""
    ask_by_hand(app)
    beside: list[tuple[Asked, Asked]] = []
    for node in random.Random(SEED).sample(
        [each for each in sorted(hands.poses) if not hands.is_crowded(each)], TOUCHED
    ):
        hands.look_at_node(node)
        x, y = hands.points_of_node(node)[0]
        around = [(x + FAR_PX * math.cos(turn), y + FAR_PX * math.sin(turn)) for turn in np.arange(0.0, 6.28, 0.2)]
        if (bare := next((each for each in around if hands.about_at(each) == ""), None)) is not None:
            beside.append((["pick", node], hands.tap(["pick", node], bare)))
    assert all(taken is not None for _, taken in beside)  # It may be an edge that is nearer still.
    assert any(wanted == taken for wanted, taken in beside)


def pixels(page: Page) -> np.ndarray:
    """Return what the map shows."""
    wait_until_drawn(page)
    shot = page.locator(PLAN).screenshot(timeout=PATIENCE_MS)
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), int)


@pytest.mark.parametrize("layer", ["nodes", "edges", "rooms", "doors", "robot"])
def test_a_key_of_the_legend_hides_what_it_names_and_shows_it_again(page: Page, hands: PlanHands, layer: str) -> None:
    page.mouse.move(5, 5)
    key = page.locator(f"#ltvn-legend [data-layer={layer}]")
    before = pixels(page)
    key.click()
    expect(key).to_have_attribute("aria-pressed", "false")
    until(lambda: (pixels(page) != before).any())
    key.click()
    expect(key).to_have_attribute("aria-pressed", "true")
    until(lambda: (pixels(page) == before).all())


def eye(page: Page) -> tuple[float, float, float]:
    """Return the middle of the view in metres, and pixels a metre."""
    x, y, scale = map(float, (page.locator(PLAN).get_attribute("data-eye") or "").split())
    return x, y, scale


def test_the_wheel_grows_the_map_around_the_pointer_and_a_key_shows_the_whole_again(
    page: Page, hands: PlanHands
) -> None:
    whole, place = eye(page), next(iter(hands.poses.values()))[:2]
    before = on_screen(page, *place)
    page.mouse.move(*before)
    page.mouse.wheel(0, -400)
    until(lambda: hands.scale > 1.5 * whole[2])
    assert on_screen(page, *place) == pytest.approx(before, abs=1.5)
    page.locator("#ltvn-whole").click()
    until(lambda: eye(page) == pytest.approx(whole))


def touch(session: CDPSession, kind: str, *points: tuple[float, float]) -> None:
    fingers = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
    session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})


def test_what_is_under_two_fingers_stays_under_them(page: Page, hands: PlanHands) -> None:
    x, y = map(round, on_screen(page, *eye(page)[:2]))
    places = [(eye(page)[0] + dx / hands.scale, eye(page)[1]) for dx in (-40, 40)]
    session = page.context.new_cdp_session(page)
    touch(session, "touchStart", (x - 40, y), (x + 40, y))
    for gone in (20, 40, 60, 80, 100):
        touch(session, "touchMove", (x - 40, y), (x + 40 + gone, y + gone // 4))
    touch(session, "touchEnd")
    until(lambda: hands.scale > 0)
    assert on_screen(page, *places[0]) == pytest.approx((x - 40, y), abs=30)
    assert on_screen(page, *places[1])[0] == pytest.approx(x + 140, abs=30)


def test_arrows_move_the_map_where_tab_put_the_focus_and_drive_nothing(
    app: RunningApp, page: Page, hands: PlanHands
) -> None:
    wait_for_rest(app)
    before, view = app.session.state.live.robot.drawn_pose.copy(), eye(page)
    page.locator("body").evaluate("body => { body.tabIndex = -1; body.focus(); }")
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate(f"document.activeElement.matches('{PLAN}')"):
            break
    page.keyboard.press("ArrowRight")
    until(lambda: eye(page)[0] > view[0])
    page.keyboard.press("ArrowUp")
    until(lambda: eye(page)[1] > view[1])
    page.keyboard.press("Equal")
    until(lambda: eye(page)[2] > view[2])
    page.keyboard.press("Digit0")
    until(lambda: eye(page) == pytest.approx(view))
    page.keyboard.press("Escape")
    assert (app.session.state.live.robot.drawn_pose == before).all()


def test_a_click_on_an_edge_asks_about_it(app: RunningApp, hands: PlanHands) -> None:
    poses = hands.poses
    long = max(hands.edges, key=lambda edge: math.dist(*(poses[node][:2] for node in edge)))
    point, _ = hands.find_edge(long)
    hands.take(point, lambda: selected_edge(app) == long)
    assert app.session.state.debugger.shown.question is QuestionName.EDGE


def test_a_click_on_a_door_closes_it_and_another_one_opens_it(app: RunningApp, hands: PlanHands) -> None:
    world = app.session.state.world
    assert world is not None
    door = world.view.doors[0]
    for is_open in (False, True):
        hands.look_at(np.array([door.x, door.y]), 150)
        point = on_screen(hands.page, door.x, door.y)
        hands.point_at(f"door {door.door}", [point])
        hands.take(point, lambda is_open=is_open: world.view.doors[0].is_open == is_open)


def test_nothing_is_drawn_while_nothing_changes(app: RunningApp, chromium: Browser) -> None:
    wait_for_rest(app)
    page = chromium.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(PATIENCE_MS)
    page.add_init_script(COUNT_STROKES)
    page.goto(app.server.url)
    page.get_by_text("Next:").wait_for()
    wait_until_drawn(page)

    def rests() -> bool:
        before = page.evaluate("window.strokes")
        page.wait_for_timeout(REST_MS)
        return page.evaluate("window.strokes") == before

    assert page.evaluate("window.strokes") > 0
    until(rests, patience_s=30.0)
    page.close()
