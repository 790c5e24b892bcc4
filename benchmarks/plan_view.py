"""`python -m benchmarks.plan_view`: how quickly a page draws the map from above, and what it costs, without a GPU.

Needs Chromium, Linux and an idle machine; it says how busy it was. The demo is driven by keys; a map of 10,000 nodes
and 50,000 edges is moved by the mouse.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.measurement import Measurement, measured
from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.cli import run_verb
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

WINDOW = (1400, 900)
NODES, EDGES = 10_000, 50_000
DRIVE_S, REST_S, PAN_S = 5.0, 8.0, 5.0
_COUNT_FRAMES = """() => {
  window.frames_ = 0;
  const count = () => { window.frames_++; requestAnimationFrame(count); };
  requestAnimationFrame(count);
}"""


@dataclass(frozen=True)
class PlanViewSummary:
    """What the plan view costs."""

    cores: int
    load: float
    """Mean number of processes that wanted a core in the minute before; far above 0, frames come late."""
    measurements: list[Measurement]


@dataclass(frozen=True, kw_only=True)
class PlanViewVerb(Verb):
    """Measure the map from above in a browser that draws by software; takes a minute."""

    def run(self) -> Summary:
        """Measure; raises LtvnError."""
        from playwright.sync_api import sync_playwright

        from tests.browser.chromium import chromium_path
        from tests.browser.conftest import FLAGS

        load = os.getloadavg()[0]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
            measurements = [*_drive(browser), *_pan(browser)]
            browser.close()
        return PlanViewSummary(os.cpu_count() or 1, load, measurements)


def _drive(browser: "Browser") -> Iterator[Measurement]:
    """Turn on the spot and stand still in the demo."""
    from ltvn_viz.app import AppOptions
    from tests.browser.running_app import running_app

    with tempfile.TemporaryDirectory() as folder, running_app(AppOptions(port=0, recordings=Path(folder))) as app:
        opened = time.monotonic()
        with _opened(browser, app.server.url) as page:
            page.wait_for_function("() => Number(document.getElementById('ltvn-plan').dataset.nodes) > 100")
            yield measured("open page to the map", time.monotonic() - opened, "s", at_most=8.0)
            page.wait_for_timeout(3000)
            at_rest = _cpu_share(lambda: page.wait_for_timeout(1000 * REST_S), of=browser_pids)
            yield measured("browser, page at rest", 100 * at_rest, "% of a core", at_most=15.0)
            page.keyboard.down("a")
            share = _cpu_share(lambda: page.wait_for_timeout(1000 * DRIVE_S), of=browser_pids)
            frames = _frames_shown(browser, page) / DRIVE_S  # Counting costs time, too, so it comes afterwards.
            page.keyboard.up("a")
            yield measured("frames while driving", frames, "1/s", at_least=30.0)
            yield measured("processor time of the browser a frame", 1000 * share / frames, "ms", at_most=15.0)


def _frames_shown(browser: "Browser", page: "Page") -> int:
    """Count the pictures that the browser shows in `DRIVE_S` seconds, also those that no script asked for."""
    tracing = browser.new_browser_cdp_session()
    events = list[dict[str, Any]]()
    is_over = Event()
    tracing.on("Tracing.dataCollected", lambda data: events.extend(data["value"]))
    tracing.on("Tracing.tracingComplete", lambda _: is_over.set())
    tracing.send("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": {"includedCategories": ["viz"]}})
    page.wait_for_timeout(1000 * DRIVE_S)
    tracing.send("Tracing.end")
    while not is_over.is_set():
        page.wait_for_timeout(100)
    tracing.detach()
    return sum(event["name"] == "Display::DrawAndSwap" and event["ph"] == "X" for event in events)


def _pan(browser: "Browser") -> Iterator[Measurement]:
    """Move a large map by the mouse."""
    from ltvn_viz.layers.first_view import Floor
    from ltvn_viz.layers.plan_view import PlanView
    from ltvn_viz.panels.status_panel import PANEL_MARK
    from ltvn_viz.server.guarded_server import GuardedServer
    from ltvn_viz.session.snapshot import Snapshot
    from ltvn_viz.timeline.run_moment import RunMoment

    with GuardedServer() as server:
        server.gui.add_html(PANEL_MARK)
        view = PlanView(server.tell, lambda _name, _state: None, LOCOBOT, Floor((0.0, 0.0), (40.0, 40.0)))
        server.add_route("/map/", view.changes.since, ending="json")
        view.show(Snapshot(moment=RunMoment(robot=np.zeros(3), graph=large_map())))
        with _opened(browser, server.url) as page:
            page.wait_for_function(f"() => Number(document.getElementById('ltvn-plan').dataset.nodes) === {NODES}")
            page.wait_for_timeout(3000)
            box = page.locator("#ltvn-plan").bounding_box()
            assert box is not None
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.evaluate(_COUNT_FRAMES)
            page.mouse.move(x, y)
            page.mouse.down()
            until = time.monotonic() + PAN_S
            angle = 0.0
            while time.monotonic() < until:
                angle += 0.1
                page.mouse.move(x + 80 * np.sin(angle), y + 80 * np.cos(angle))
            page.mouse.up()
            frames = page.evaluate("window.frames_") / PAN_S
            yield measured(f"frames while {NODES:,} nodes and {EDGES:,} edges are moved", frames, "1/s", at_least=10.0)


def large_map() -> GraphArrays:
    """Return a map whose edges join near nodes."""
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(0, 40, (NODES, 2)), rng.uniform(-np.pi, np.pi, NODES)])
    poses = poses[np.lexsort((poses[:, 1], poses[:, 0].round()))]
    source = rng.integers(0, NODES - 8, EDGES)
    edges = np.unique(np.column_stack([source, source + rng.integers(1, 8, EDGES)]), axis=0)
    flags = np.zeros(len(edges), np.bool_)
    return GraphArrays(
        ids=np.arange(NODES),
        poses=poses,
        edges=edges,
        p=rng.uniform(0, 1, len(edges)),
        attempts=flags.astype(np.int64),
        acts=flags,
        exits=np.zeros(NODES, np.bool_),
    )


@contextmanager
def _opened(browser: "Browser", url: str) -> "Iterator[Page]":
    page = browser.new_page(viewport={"width": WINDOW[0], "height": WINDOW[1]}, color_scheme="dark")
    page.set_default_timeout(120_000)
    try:
        page.goto(url)
        yield page
    finally:
        page.close()


def browser_pids() -> list[int]:
    """Return the processes of the browser that this one started."""
    children: dict[int, list[int]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text(encoding="utf-8")
        except OSError:
            continue
        children.setdefault(int(text.rsplit(")", 1)[1].split()[1]), []).append(int(text.split(" ", 1)[0]))
    found, new = list[int](), [os.getpid()]
    while new:
        found += new
        new = [child for parent in new for child in children.get(parent, [])]
    return [pid for pid in found if "chrom" in _name_of(pid)]


def _name_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/comm").read_text(encoding="utf-8")
    except OSError:
        return ""


def _cpu_share(work: Callable[[], object], of: Callable[[], list[int]]) -> float:
    """Return the share of one core that processes use while `work` runs."""
    pids = of()
    before, begun = _cpu_s(pids), time.monotonic()
    work()
    return (_cpu_s(pids) - before) / (time.monotonic() - begun)


def _cpu_s(pids: list[int]) -> float:
    ticks = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
        except OSError:
            continue
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.plan_view", PlanViewVerb))
