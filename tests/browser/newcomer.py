"""Somebody who sees the page for the first time and does what it says: picks a goal, then presses “Watch it learn”.

Owns what a newcomer reads and clicks, in order. Test and benchmark say what must come of it.
"""

from collections.abc import Sequence

from playwright.sync_api import Page, expect

from tests.browser.actions import App, click_goal_image
from tests.waiting import PATIENCE_S, until

HINT = ".lt-hint"
FADED = ("seen blocked", "pruned")
"""What the timeline says of an edge that fades."""
NEW = ("came in",)
_POINT_EVERYWHERE = """() => {
  const strip = document.querySelector(".ltvn-time-strip"), said = new Set();
  const { left, right, top } = strip.getBoundingClientRect();
  for (let x = left; x < right; x += 4) {
    strip.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: top + 30, pointerType: "mouse" }));
    for (const line of document.querySelectorAll(".ltvn-time-hint > div")) said.add(line.textContent);
  }
  strip.dispatchEvent(new PointerEvent("pointerleave"));
  return [...said];
}"""


def reach_first_goal(app: App, page: Page) -> None:
    """Pick the first image under “Go”, as the page says, and wait until the page says that the robot arrived."""
    expect(page.locator(HINT)).to_contain_text("Pick a goal")
    page.get_by_role("tab", name="Go").click()
    click_goal_image(app, page, lambda offered: offered[0])
    expect(page.locator(HINT)).to_contain_text("yellow is the plan")
    # On a busy computer robot time passes slowly; `first_query_s` tells it.
    until(
        lambda: app.session.state.live.timeline.queries[0].end is not None,
        patience_s=3 * PATIENCE_S,
        meanwhile=lambda: page.wait_for_timeout(100),
    )
    expect(page.locator(HINT)).to_contain_text("Arrived. Pick the next goal")


def first_query_s(app: App) -> float:
    """Return how long the first query took, in seconds of robot time, which a busy computer does not change."""
    query = app.session.state.live.timeline.queries[0]
    assert query.end is not None
    return query.end.stamp - query.begin.stamp


def begin_story(page: Page) -> None:
    """Press the blue button of the tab “World”, which tells what happens from now on."""
    page.get_by_role("tab", name="World").click()
    page.get_by_role("button", name="Watch it learn").click()


def wait_for_mark(page: Page, words: Sequence[str]) -> None:
    """Wait until the timeline has a mark that says one of these words."""
    until(
        lambda: any(each in said for said in timeline_words(page) for each in words),
        meanwhile=lambda: page.wait_for_timeout(100),
        explain=lambda: timeline_words(page),
    )


def timeline_words(page: Page) -> list[str]:
    """Return what the timeline says, from left to right, as one points along it."""
    return page.evaluate(_POINT_EVERYWHERE)
