"""A person's hands on the map from above: find a node or an edge, look closer, point at it, and see what is taken.

Owns where in the window a thing of the map can be pointed at. What comes of a click is the business of whoever clicks.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.app import RunningApp
from ltvn_viz.timeline.run_moment import moment_of
from tests.browser.pages import PLAN, on_screen, wait_until_drawn
from tests.waiting import until

Point = tuple[float, float]
"""Of the window, in pixels."""
WHEEL = 1.0015
"""The map grows by this factor with each pixel of the wheel."""
SPANS_PX = 60, 240, 6
"""An edge is long enough to be pointed at; among many nodes one looks closer, or from so far that they are one."""
SAME_PX = 8
"""Nodes that are no farther apart in the window stand at one place, as in `plan_pick.js`."""
APART_PX = 40
"""Places so far apart can be told from each other."""
SAME_M = 0.02
TICKS_PX = (24.0, 20.0, 8.0, 5.0, 0.0)
"""So far from a node's middle, along its heading, one points at it."""
ALONG = (0.5, 0.4, 0.6, 0.3, 0.7, 0.25, 0.75, 0.2, 0.8)
LANE_PX, BUNDLE_PX = 1.5, 3.0
LANES = sorted(range(-30, 31), key=abs)
FAN_PX = 40
"""Headings at one place are spread so far from it."""
OUTSIDE = (5.0, 5.0)
"""No place of the map."""
MOST_SCALE = 590.0


NOTE_ASKED = """
window.asked = null;
const post = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (said, ...more) {
  if (said?.type === "ask") window.asked = [said.message.action, said.message.value];
  return post.call(this, said, ...more);
};
"""
"""Lets a page note what it asked for last."""
Asked: TypeAlias = list[object] | None
_LOOK = """async ([x, y, scale, factor, isWhole]) => {
  const plan = document.querySelector("#ltvn-plan");
  const drawn = async () => { do await new Promise((done) => setTimeout(done, 10)); while (!plan.dataset.drawn); };
  if (isWhole) document.querySelector("#ltvn-whole").click();
  await drawn();
  const [eyeX, eyeY, eyeScale] = plan.dataset.eye.split(" ").map(Number);
  const box = plan.getBoundingClientRect();
  const [px, py] = [box.x + box.width / 2 + (x - eyeX) * eyeScale, box.y + box.height / 2 - (y - eyeY) * eyeScale];
  const corners = [[-50, -50], [-50, 50], [50, -50], [50, 50]];
  if (!corners.every(([dx, dy]) => document.elementFromPoint(px + dx, py + dy) === plan)) return false;
  if (scale > eyeScale) {
    const deltaY = -Math.log(scale / eyeScale) / Math.log(factor);
    plan.dispatchEvent(new WheelEvent("wheel", { clientX: px, clientY: py, deltaY, cancelable: true }));
    await drawn();
  }
  return true;
}"""
_POINT = """([points, about, pointerType]) => {
  const [plan, card] = [document.querySelector("#ltvn-plan"), document.querySelector("#ltvn-card")];
  const seen = [];
  for (const [clientX, clientY] of points) {
    const isInside = document.elementFromPoint(clientX, clientY) === plan;
    const kind = isInside ? "pointermove" : "pointerleave";
    plan.dispatchEvent(new PointerEvent(kind, { clientX, clientY, pointerType, pointerId: 1 }));
    seen.push(isInside ? card.dataset.about : "");
    if (seen.at(-1) === about) break;
  }
  return seen;
}"""


@dataclass(frozen=True)
class PlanHands:
    """The map that an app shows, and the page where it is shown."""

    app: RunningApp
    page: Page

    @property
    def poses(self) -> dict[NodeId, NDArray[np.float64]]:
        graph = moment_of(self.app.session.state.shown_run).graph
        return dict(zip(map(int, graph.ids), graph.poses, strict=True))

    @property
    def edges(self) -> list[EdgeKey]:
        graph = moment_of(self.app.session.state.shown_run).graph
        return [(int(a), int(b)) for a, b in graph.ids[graph.edges]]

    @property
    def scale(self) -> float:
        """Pixels a metre."""
        return float((self.page.locator(PLAN).get_attribute("data-eye") or "0 0 0").split()[2])

    @property
    def about(self) -> str:
        """What is under the pointer."""
        return self.page.locator("#ltvn-card").get_attribute("data-about") or ""

    def show_whole(self) -> None:
        """Press the key that shows the whole floor."""
        self.page.locator("#ltvn-whole").click()
        wait_until_drawn(self.page)

    def look_at(self, place: NDArray[np.float64], scale: float) -> None:
        """Show the whole floor, and grow a place (2,) in metres by the wheel to so many pixels a metre."""
        wanted = min(scale, MOST_SCALE)
        is_free = self.page.evaluate(_LOOK, [*map(float, place), wanted, WHEEL, True])
        while not is_free:
            self.drag_towards_middle(on_screen(self.page, *place))
            is_free = self.page.evaluate(_LOOK, [*map(float, place), wanted, WHEEL, False])

    def drag_towards_middle(self, point: Point) -> None:
        """Drag the map so that what is at a point comes nearer to the middle."""
        box = self.page.locator(PLAN).bounding_box()
        assert box is not None
        middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
        step = middle - point
        step *= min(1.0, 150 / float(np.hypot(*step)))
        self.page.mouse.move(*middle)
        self.page.mouse.down()
        self.page.mouse.move(*(middle + step), steps=3)
        self.page.mouse.up()

    def look_at_node(self, node: NodeId) -> None:
        """Look so closely that the place of a node is by itself."""
        poses = self.poses
        away = np.hypot(*(np.array([pose[:2] for pose in poses.values()]) - poses[node][:2]).T)
        self.look_at(poses[node][:2], APART_PX / float(away[away > SAME_M].min()))

    def points_of_node(self, node: NodeId) -> list[Point]:
        """Return points where a person would point at a node, whose heading one sees; the pointer is there first."""
        x, y, yaw = map(float, self.poses[node])
        px, py = on_screen(self.page, x, y)
        ticks = ((px + reach * math.cos(yaw), py - reach * math.sin(yaw)) for reach in TICKS_PX)
        return [(px, py), *ticks, *around(np.array([px, py]))]  # Headings that are nearly equal push each other aside.

    def is_crowded(self, node: NodeId) -> bool:
        """Tell whether several nodes stand at the place of one."""
        here = self.poses[node]
        return sum(float(np.hypot(*(pose - here)[:2])) < SAME_M for pose in self.poses.values()) > 1

    def find_edge(self, edge: EdgeKey) -> tuple[Point, list[Point]]:
        """Look closer until an edge can be pointed at; return where, and all points along it."""
        about = f"edge {edge[0]},{edge[1]}"
        start, end = (self.poses[node][:2] for node in edge)
        length = float(np.hypot(*(end - start)))
        points, seen = list[Point](), list[str]()
        for spans_px in SPANS_PX:
            if length < SAME_M:
                self.look_at_node(edge[0])
            else:
                self.look_at((start + end) / 2, spans_px / length)
            points = self.points_of_edge(edge)
            seen = self._seen_at(points, about, "mouse")
            if seen[-1] == about:
                break
        return self._found(about, points, seen), points

    def points_of_edge(self, edge: EdgeKey) -> list[Point]:
        """Return points along an edge, on the line between its nodes and on both sides of it.

        The pointer moves there first: what lies at one place is spread where the pointer is.
        """
        start, end = (np.array(on_screen(self.page, *map(float, self.poses[node][:2]))) for node in edge)
        if self.is_turn(edge):
            return [(float(start[0]), float(start[1])), *around(start)]
        lanes = zip(*(along(start, end, lane) for lane in LANES), strict=True)
        return [point for lane in lanes for point in (*lane, OUTSIDE)]  # Outside, nothing is spread any more.

    def places_to_tap(self, points: list[Point]) -> list[Point]:
        """Return those of an edge's points that lie on the edge itself, while nothing is spread."""
        return points[:: len(LANES) + 1]

    def is_turn(self, edge: EdgeKey) -> bool:
        """Tell whether an edge joins two headings at what is one place in the window."""
        return float(np.hypot(*(self.poses[edge[0]] - self.poses[edge[1]])[:2])) * self.scale < SAME_PX

    def point_at(self, about: str, points: list[Point], pointer: str = "mouse") -> Point:
        """Move a pointer until the page says that a thing is below it, and return where that is."""
        return self._found(about, points, self._seen_at(points, about, pointer))

    def _found(self, about: str, points: list[Point], seen: list[str]) -> Point:
        """Return the point where a thing was seen last."""
        assert seen[-1] == about, f"nowhere is {about} under the pointer, but {seen}"
        x, y = points[len(seen) - 1]
        return round(x), round(y)

    def _seen_at(self, points: list[Point], until: str, pointer: str) -> list[str]:
        """Return what is under a pointer at points, up to the thing that is looked for."""
        whole = [(round(x), round(y)) for x, y in points]  # As the window's own pointer moves: by whole pixels.
        return self.page.evaluate(_POINT, [whole, until, pointer])

    def about_at(self, point: Point) -> str:
        """Return what is under a pointer at a point."""
        return self._seen_at([point], "-", "mouse")[0]

    def take(self, point: Point, took_effect: Callable[[], bool]) -> None:
        """Click once, and wait for what comes of it."""
        self.page.mouse.click(*point)
        until(took_effect, patience_s=20.0)

    def tap(self, wanted: Asked, *places: Point) -> Asked:
        """Tap the first of some places where nothing else is nearer, and return what the page asked for.

        Where several things lie, that tap spreads them, and asks for nothing: then tap what is wanted among them.
        """
        asked: Asked = None
        for place in places:
            self.page.mouse.move(*OUTSIDE)
            self.page.evaluate(_POINT, [[OUTSIDE], "", "mouse"])  # Nothing is spread any more.
            asked = self._asked_by_tap(*place)
            if asked in (None, wanted):
                break
        return asked

    def tap_among(self, about: str, points: list[Point]) -> Asked:
        """Tap a thing among those that a tap has spread, and return what the page asked for."""
        return self._asked_by_tap(*self.point_at(about, points, "touch"))

    def _asked_by_tap(self, x: float, y: float) -> Asked:
        self.page.evaluate("window.asked = null")
        self.page.touchscreen.tap(x, y)
        return self.page.evaluate("window.asked")


def around(middle: NDArray[np.float64]) -> Iterator[Point]:
    """Return points of a disc in the window, from its middle outwards."""
    places = [(dx, dy) for dx in range(-FAN_PX, FAN_PX + 1, 3) for dy in range(-FAN_PX, FAN_PX + 1, 3)]
    for dx, dy in sorted(places, key=lambda place: math.hypot(*place)):
        yield float(middle[0]) + dx, float(middle[1]) + dy


def along(start: NDArray[np.float64], end: NDArray[np.float64], beside: int) -> Iterator[Point]:
    """Return points along a line between two points of the window, in a lane beside it, 0 on it, 1 to its right."""
    forward = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    lane = (LANE_PX + beside * BUNDLE_PX) * np.array([-forward[1], forward[0]])
    for share in ALONG:
        x, y = start + share * (end - start) + lane
        yield float(x), float(y)
