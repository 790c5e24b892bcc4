"""Take the pictures of `docs/debugging.md`: the page in a browser, asked as the tests ask it.

    python -m tests.browser.debugger_screenshots [NAME ...]

Needs Chromium. Owns which pictures there are.
"""

import re
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes.commands import OpenRecording, Seek
from tests.browser.chromium import chromium_path
from tests.browser.conftest import FLAGS
from tests.browser.debugger_page import LAST_S, WINDOW, DebuggerPage, open_debugger
from tests.browser.pages import wait_until_drawn
from tests.browser.screenshots import save, shown
from tests.repository import ROOT
from tests.waiting import PATIENCE_S

FOLDER = ROOT / "docs" / "images" / "debugging"
_COLOURS = 2000
"""A viewer that is still loading shows fewer."""


def wall(debugger: DebuggerPage) -> None:
    """Point at the edge through the wall."""
    debugger.go_to_failure(0)
    debugger.follow(re.compile("^edge "))


def alike(debugger: DebuggerPage) -> None:
    """Point at the edge between look-alikes."""
    debugger.go_to_failure(2)
    debugger.follow(re.compile("^edge "))


def edge(debugger: DebuggerPage) -> None:
    """Both images of the edge to blame."""
    alike(debugger)
    debugger.ask(QuestionName.EDGE)


def blame(debugger: DebuggerPage) -> None:
    """Why the robot set out through a wall."""
    wall(debugger)
    debugger.ask(QuestionName.EDGE)
    debugger.says("The best path without it costs")


def history(debugger: DebuggerPage) -> None:
    """The moment of the prune."""
    debugger.go_to_failure(0)
    debugger.ask(QuestionName.TIME)
    debugger.answer.locator("tr", has_text="pruned").locator("a", has_text="›").click()
    debugger.says("pruned (attempt)")


def what_if(debugger: DebuggerPage) -> None:
    """The way around the wall."""
    wall(debugger)
    debugger.ask(QuestionName.WHAT_IF)
    debugger.follow(re.compile("^without "))
    debugger.says("instead of")


def where(debugger: DebuggerPage) -> None:
    """The pair that looks alike."""
    debugger.go_to_failure(2)
    debugger.ask(QuestionName.WHERE)
    debugger.says("near enough")
    if "pairs of perceptual aliases" not in debugger.shown.html:
        debugger.follow(re.compile("^search for places"))
    debugger.says("pairs of perceptual aliases")


def breaks(debugger: DebuggerPage) -> None:
    """Stops at each failed leg."""
    debugger.go_to_failure(1)
    debugger.ask(QuestionName.BREAK)
    debugger.follow("failed leg")


def compare(debugger: DebuggerPage) -> None:
    """The faulty map against the good one."""
    debugger.compare_with("demo-map.rrd")
    debugger.says("nodes", "edges", "pieces", "believed differently")


def truth(debugger: DebuggerPage) -> None:
    """All faults at once."""
    alike(debugger)
    debugger.ask(QuestionName.TRUTH)
    debugger.says("precision")


def failures(debugger: DebuggerPage) -> None:
    """All that failed, at the end of the recording."""
    debugger.app.session.send(Seek(LAST_S))
    debugger.ask(QuestionName.FAILURES)
    debugger.says("queries failed")


def share(debugger: DebuggerPage) -> None:
    """A moment that was saved."""
    debugger.go_to_failure(2)
    debugger.ask(QuestionName.SHARE)
    debugger.follow("save this moment")
    debugger.says("Written: ")


def coach(debugger: DebuggerPage) -> None:
    """The robot itself."""
    debugger.go_to_the_robot()
    debugger.ask(QuestionName.COACH)
    debugger.says("% new")


def hand(debugger: DebuggerPage) -> None:
    """A change that can be undone."""
    debugger.cut_what_differs("demo-fault.rrd")


PICTURES: dict[str, Callable[[DebuggerPage], None]] = {
    "failures": failures,
    "edge": edge,
    "where": where,
    "truth": truth,
    "blame": blame,
    "history": history,
    "what-if": what_if,
    "breaks": breaks,
    "compare": compare,
    "share": share,
    "coach": coach,
    "hand": hand,
}
"""In this order: the last ones leave the recording."""


def main(names: list[str]) -> int:
    """Take the named pictures, or all."""
    # The page names the folder, as it was given.
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder, chdir(folder):
        recordings = Path("recordings")
        recordings.mkdir()
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        with open_debugger(browser, recordings, "demo-fault.rrd") as debugger:
            _clear_the_view(debugger.page)
            for name, show in PICTURES.items():
                if not names or name in names:
                    show(debugger)
                    _drawn(debugger)
                    save(debugger.page, FOLDER / f"{name}.webp")
            if not names or "rerun" in names:
                _rerun(browser, debugger)
    return 0


def _rerun(browser: Browser, debugger: DebuggerPage) -> None:
    """The recording in Rerun's viewer, as the page opens it."""
    if not debugger.is_replay:
        debugger.app.session.send(OpenRecording("demo-fault.rrd", 9.0))
        debugger.until(lambda: debugger.is_replay)
    debugger.ask(QuestionName.SHARE)
    debugger.follow("open in Rerun")
    debugger.says("Rerun is open here")
    address = debugger.answer.get_by_text("Rerun is open here").get_attribute("href")
    assert address is not None
    viewer = browser.new_page(viewport=WINDOW)
    viewer.goto(address)
    _complete(viewer)
    save(viewer, FOLDER / "rerun.webp")
    viewer.close()


def _complete(viewer: Page) -> None:
    """Wait until the viewer has opened the file, shows many colours, and shows nothing new any more."""
    deadline, before = time.monotonic() + PATIENCE_S, None
    while time.monotonic() < deadline:
        now = shown(viewer)
        is_open = viewer.evaluate("document.body.dataset.shown === 'yes'")
        if is_open and now == before and len(now.getcolors(2**24) or ()) >= _COLOURS:
            return
        before = now
        viewer.wait_for_timeout(2000)


def _clear_the_view(page: Page) -> None:
    """Put away what has nothing to do with the debugger: the robot's pictures, the driving pad, notices."""
    page.add_style_tag(content="#ltvn-cockpit, .mantine-Notification-root {display: none !important}")


def _drawn(debugger: DebuggerPage) -> None:
    """Wait until the browser has drawn the scene anew."""
    wait_until_drawn(debugger.page)
    debugger.page.mouse.move(5, 5)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
