"""Where everything stands on the page, from a telephone to a wall of pixels: nothing covers anything."""

import re
from collections.abc import Iterator
from itertools import combinations
from typing import Literal, TypeAlias

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, FloatRect, Page, expect

from ltvn_viz.wishes import commands as c
from tests.browser.actions import wait_for_rest
from tests.browser.flat_app import FlatApp, navigate_far, serving
from tests.browser.pages import PLAN, draw_nothing, on_screen, open_page
from tests.waiting import PATIENCE_MS, PATIENCE_S, until

pytestmark = pytest.mark.browser

WINDOWS = ((360, 640), (390, 844), (844, 390), (820, 1180), (1100, 700), (1400, 900), (1920, 1080), (3840, 2160))
Scheme: TypeAlias = Literal["dark", "light"]
TABS = ("Drive", "Go", "World", "Replay", "Why")
PARTS = {
    "scene": PLAN,
    "pictures": "#ltvn-pictures",
    "pad": ".ltvn-pad",
    "panel": "#root .mantine-Paper-root:has([data-ltvn-panel])",
    "head of the panel": "#ltvn-panel-head",
    "legend": "#ltvn-legend",
    "timeline": "#timeline-dock",
    "bar": "#ltvn-bar",
    "tabs of a narrow window": "#ltvn-nav",
}
CANVAS = "#root canvas[data-engine]"
"""Of the 3D scene."""
LEAST_SCENE_PX = 120
POINTERS_OF = """named => [...document.querySelectorAll(named)].filter((each) => each.checkVisibility())
  .map((each) => getComputedStyle(each).pointerEvents)"""
_SMALL_PRINT = """() => [...document.querySelectorAll("body *")].filter((shown) =>
    shown.checkVisibility({ visibilityProperty: true }) &&
    [...shown.childNodes].some((child) => child.nodeType === Node.TEXT_NODE && child.data.trim() !== "") &&
    !["STYLE", "SCRIPT", "NOSCRIPT"].includes(shown.tagName) &&
    parseFloat(getComputedStyle(shown).fontSize) < 12.99
).map((shown) => shown.textContent.trim().slice(0, 60))"""
_NOTE_FIRST_PLACE = """
new MutationObserver((_, observer) => {
  observer.disconnect();
  window.firstTop = document.querySelector("#root [role=tab]").getBoundingClientRect().top;
}).observe(document, { subtree: true, attributeFilter: ["data-ltvn-ready"] });
"""
_NAME_IN_FOCUS = """() => {
    const shown = document.activeElement;
    return (shown.getAttribute("aria-label") ?? shown.textContent).trim();
}"""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        yield app


@pytest.fixture(scope="module")
def trouble() -> list[str]:
    """What the page complained about in its console."""
    return []


@pytest.fixture(scope="module")
def page(app: FlatApp, chromium: Browser, trouble: list[str]) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1400, height=900, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        page.on("pageerror", lambda error: trouble.append(f"{error.name}: {error.message}"))
        page.on("console", lambda said: trouble.extend([said.text] if said.type == "error" else []))
        page.reload()
        page.get_by_text("Next:").wait_for()
        yield page


def rectangles(page: Page) -> dict[str, FloatRect]:
    """Return where the parts that are there stand."""
    shown = {name: page.locator(f"{selector} >> visible=true") for name, selector in PARTS.items()}
    boxes = {name: part.bounding_box() for name, part in shown.items() if part.count() == 1}
    return {name: box for name, box in boxes.items() if box is not None and box["width"] and box["height"]}


def overlap(one: FloatRect, other: FloatRect) -> bool:
    """Tell whether two rectangles share more than a border of half a pixel."""
    across = min(one["x"] + one["width"], other["x"] + other["width"]) - max(one["x"], other["x"])
    down = min(one["y"] + one["height"], other["y"] + other["height"]) - max(one["y"], other["y"])
    return across > 0.5 and down > 0.5


def overlapping(page: Page) -> list[tuple[str, str]]:
    boxes = rectangles(page)
    return [(one, other) for one, other in combinations(boxes, 2) if overlap(boxes[one], boxes[other])]


def fits(page: Page, width: int, height: int) -> bool:
    """Tell whether nothing overlaps, nothing is cut off, and the scene is of use."""
    boxes = rectangles(page)
    inside = all(
        box["x"] >= -0.5
        and box["y"] >= -0.5
        and box["x"] + box["width"] <= width + 0.5
        and box["y"] + box["height"] <= height + 0.5
        for box in boxes.values()
    )
    scene = boxes["scene"]
    return not overlapping(page) and inside and min(scene["width"], scene["height"]) >= LEAST_SCENE_PX


@pytest.mark.parametrize(("width", "height"), WINDOWS)
def test_nothing_covers_anything_and_nothing_is_cut_off(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    until(
        lambda: fits(page, width, height),
        patience_s=PATIENCE_S / 8,
        explain=lambda: (overlapping(page), rectangles(page)),
    )
    assert {"scene", "pictures", "pad", "timeline"} <= rectangles(page).keys()


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1400, 900), (3840, 2160)])
def test_the_whole_map_is_in_view(app: FlatApp, page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    places = app.harness.now.moment.graph.poses[:, :2]
    corners = np.array([places.min(axis=0), places.max(axis=0)])

    def fills() -> bool:
        box = rectangles(page)["scene"]
        shown = np.array([on_screen(page, *corner) for corner in corners]) - (box["x"], box["y"])
        size = np.array([box["width"], box["height"]])
        spans = np.abs(shown[1] - shown[0]) / size
        return bool((shown > 0).all() and (shown < size).all() and spans.max() > 0.5)

    until(fills)


def resize(page: Page, width: int, height: int) -> None:
    """Make the window so large, and wait until the page is laid out anew."""
    page.set_viewport_size({"width": width, "height": height})
    expect(page.locator("#ltvn-nav")).to_be_visible(visible=width < 700 or height < 480)


def is_narrow(page: Page) -> bool:
    return page.locator("#ltvn-nav").is_visible()


def open_tab(page: Page, tab: str) -> None:
    if is_narrow(page):
        page.locator("#ltvn-nav").get_by_role("button", name=tab).click()
    else:
        page.get_by_role("tab", name=tab).click()


def ask_for(page: Page, scheme: Scheme) -> None:
    """Let the system ask for dark or light colours, as it may while the page is open, and wait for the page."""
    page.emulate_media(color_scheme=scheme)
    expect(page.locator("html")).to_have_css("color-scheme", scheme)


def ground(page: Page) -> int:
    """Return how bright the page's ground is, 0 for black to 255 for white."""
    colour = page.locator("body").evaluate("body => getComputedStyle(body).backgroundColor")
    return max(int(part) for part in re.findall(r"\d+", colour)[:3])


def findings(page: Page) -> list[str]:
    """Return what axe-core finds that hinders somebody: names, roles, contrast, landmarks, headings."""
    found = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
    return [f"{each['id']}: {each['nodes'][0]['html'][:200]}" for each in found]


def small_print(page: Page) -> list[str]:
    """Return the words in view that are smaller than 13 px."""
    return page.evaluate(_SMALL_PRINT)


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize(("width", "height"), [(390, 844), (1400, 900)])
def test_every_tab_can_be_reached_and_a_sheet_be_closed_again(
    page: Page, width: int, height: int, scheme: Scheme
) -> None:
    resize(page, width, height)
    ask_for(page, scheme)
    for tab in TABS:
        open_tab(page, tab)
        expect(page.get_by_role("tabpanel").locator("visible=true")).to_have_count(1)
        assert findings(page) == []
        assert small_print(page) == []
    if is_narrow(page):
        expect(page.locator("#ltvn-pictures")).to_be_visible()
        page.get_by_role("button", name="close the panel").click()
        expect(page.get_by_role("tabpanel").locator("visible=true")).to_have_count(0)


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_settings_of_the_3d_scene_stay_behind_advanced_and_open_and_close_without_a_finding(
    page: Page, scheme: Scheme
) -> None:
    resize(page, 1400, 900)
    ask_for(page, scheme)
    open_tab(page, "Drive")
    close = page.get_by_role("button", name="close the advanced settings")
    expect(close).to_be_hidden()
    page.get_by_role("button", name="Advanced: the 3D scene").click()
    expect(page.get_by_role("button", name="Reset View")).to_be_visible()
    expect(page.get_by_text("Orbit Origin Tool")).to_be_visible()
    for unneeded in ("Dev Settings", "WorldAxes"):
        expect(page.get_by_text(unneeded)).to_be_hidden()
    assert findings(page) == []
    close.click()
    expect(page.get_by_role("tab", name="Drive")).to_be_visible()
    expect(close).to_be_hidden()


def test_a_telephone_on_its_side_shows_a_row_of_goals(page: Page) -> None:
    resize(page, 844, 390)
    open_tab(page, "Go")
    image = page.get_by_role("tabpanel").locator(".lt-gallery img").first
    image.wait_for()

    def is_whole() -> bool:
        goal, nav = image.bounding_box(), page.locator("#ltvn-nav").bounding_box()
        return goal is not None and nav is not None and goal["y"] + goal["height"] <= nav["y"]

    until(is_whole, patience_s=PATIENCE_S / 8)
    page.get_by_role("button", name="close the panel").click()


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (820, 1180), (390, 844), (844, 390)])
def test_what_is_told_covers_neither_map_nor_picture_nor_stop_and_a_click_goes_through_it(
    page: Page, width: int, height: int
) -> None:
    resize(page, width, height)
    told = page.locator(".mantine-Notification-root:visible")
    page.keyboard.press("p")
    page.keyboard.press("p")

    def is_in_order() -> bool:
        box = told.bounding_box() if told.count() == 1 else None
        spared = [page.locator(each) for each in (PLAN, "#ltvn-pictures", "#ltvn-bar-stop")]
        boxes = [each.bounding_box() for each in spared if each.is_visible()]
        takes_clicks = page.evaluate(POINTERS_OF, ".mantine-Notification-root")
        is_beside = box is not None and not any(overlap(box, each) for each in boxes if each is not None)
        return is_beside and takes_clicks == ["none"]

    until(is_in_order, patience_s=PATIENCE_S / 8, explain=told.all)


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390)])
def test_on_a_phone_the_timeline_stays_in_view_beside_what_speaks_of_it(page: Page, width: int, height: int) -> None:
    resize(page, width, height)

    def is_free() -> bool:
        sheet, timeline = (page.locator(PARTS[name]).first.bounding_box() for name in ("panel", "timeline"))
        return sheet is not None and timeline is not None and sheet["y"] + sheet["height"] <= timeline["y"] + 1

    for tab in ("Replay", "Why"):
        open_tab(page, tab)
        until(is_free)
    page.get_by_role("button", name="close the panel").click()


def test_an_open_page_turns_dark_and_light_with_the_system(page: Page) -> None:
    ask_for(page, "dark")
    assert ground(page) < 64
    ask_for(page, "light")
    assert ground(page) > 224
    page.reload()
    page.get_by_text("Next:").wait_for(state="attached")
    assert ground(page) > 224
    ask_for(page, "dark")
    assert ground(page) < 64


def test_the_keyboard_reaches_every_control(page: Page) -> None:
    resize(page, 1400, 900)
    open_tab(page, "Drive")
    page.locator("body").evaluate("body => { body.tabIndex = -1; body.focus(); }")
    reached = []
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.append(page.evaluate(_NAME_IN_FOCUS))
    names = " | ".join(reached)
    wanted = ("show or hide the keys", "Drive", "Record", "Rebuild the map", "Advanced: the 3D scene")
    assert [name for name in wanted if name not in names] == []


def test_what_the_layout_knows_of_viser_is_there_once(page: Page) -> None:
    """A viser that builds its page otherwise must not go unnoticed."""
    known = (CANVAS, PARTS["panel"], "[data-ltvn-viser=handle]", "[data-ltvn-viser=inner]")
    assert [page.locator(selector).count() for selector in known] == [1] * len(known)
    assert page.locator("[data-ltvn-viser=handle] button").count() == 2  # The palette and, last, the settings.
    expect(page.locator("#webgl-software-rendering")).to_be_hidden()
    assert page.locator("#webgl-software-rendering").count() == 1


def test_a_finger_drives_and_is_told_of_no_keys(app: FlatApp, chromium: Browser) -> None:
    telephone = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    draw_nothing(telephone)
    page = telephone.new_page()
    page.goto(app.server.url)
    forward = page.get_by_role("button", name="drive forward")
    expect(page.locator("#ltvn-hint")).to_contain_text("Pick a goal: tap a node", use_inner_text=True)
    box = forward.bounding_box()
    assert "W A S D" not in page.locator("body").inner_text()
    assert box is not None
    assert min(box["width"], box["height"]) >= 44
    page.get_by_role("button", name="zoom in").tap()
    page.get_by_role("button", name="show the whole run").tap()
    before, touch = app.harness.robot.pose[:2].copy(), telephone.new_cdp_session(page)
    finger = {"x": box["x"] + box["width"] / 2, "y": box["y"] + box["height"] / 2}
    touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [finger]})
    until(lambda: float(np.hypot(*(app.harness.robot.pose[:2] - before))) > 0.1)
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    telephone.close()


def test_the_longest_words_of_the_pad_move_nothing_out_of_the_window(app: FlatApp, page: Page) -> None:
    wait_for_rest(app)
    navigate_far(app)
    app.session.send(c.Ask(c.Action.PAUSE))
    try:
        expect(page.locator(".ltvn-status")).to_contain_text("The robot is paused on its path to node")
        for width, height in ((390, 844), (820, 1180), (1100, 700)):
            page.set_viewport_size({"width": width, "height": height})
            until(
                lambda size=(width, height): fits(page, *size),
                patience_s=PATIENCE_S / 8,
                explain=lambda: rectangles(page),
            )
            assert page.locator("#ltvn-colour").evaluate("picture => picture.clientWidth") >= LEAST_SCENE_PX
    finally:
        app.session.send(c.Ask(c.Action.CANCEL))
        wait_for_rest(app)


def test_the_console_is_clean(page: Page, trouble: list[str]) -> None:
    page.locator("#ltvn-pictures").wait_for()
    assert trouble == []


def test_the_panel_stands_still_from_the_moment_when_the_page_is_shown(app: FlatApp, chromium: Browser) -> None:
    with chromium.new_page(viewport={"width": 1280, "height": 800}) as page:
        draw_nothing(page)
        page.add_init_script(_NOTE_FIRST_PLACE)
        page.goto(app.server.url)
        page.set_default_timeout(PATIENCE_MS)
        until(lambda: page.evaluate("window.firstTop !== undefined"))
        tab = page.get_by_role("tab", name="Drive")
        tab.click()  # Waits until the tab stands still.
        box = tab.bounding_box()
        assert box is not None
        assert box["y"] == pytest.approx(page.evaluate("firstTop"), abs=1.0)


def test_choosing_a_goal_moves_neither_the_pad_nor_the_goals(app: FlatApp, page: Page) -> None:
    resize(page, 1400, 900)
    open_tab(page, "Go")
    parts = [page.locator(".ltvn-key.ltvn-stop"), page.get_by_role("tab", name="Go")]
    parts.append(page.get_by_role("group", name="Places to go to"))
    before = [part.bounding_box() for part in parts]
    navigate_far(app)
    page.get_by_role("group", name="On the way").locator("img").first.wait_for()
    after = [part.bounding_box() for part in parts]
    app.session.send(c.Ask(c.Action.CANCEL))
    assert [box and box["y"] for box in after] == [box and box["y"] for box in before]
