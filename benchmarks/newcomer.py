"""`python -m benchmarks.newcomer`: how soon somebody who opens the demo sees a goal reached, and the map learn.

Needs Chromium, and an idle machine: it says how busy it was. Owns the budgets of a first minute on the page. What the
newcomer clicks is `tests.browser.newcomer`.
"""

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.measurement import Measurement, measured
from ltvn_core.cli import run_verb
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from ltvn_viz.app import RunningApp

GOAL_S, LEARNING_S = 30.0, 90.0
"""From the open page to the first goal; from “Watch it learn” to an edge that has faded and one that has come in."""
WINDOW = (1400, 900)


@dataclass(frozen=True)
class NewcomerSummary:
    """What the first minutes on the page were like."""

    cores: int
    load: float
    """Mean number of processes that wanted a core in the minute before; far above 0, times are too long."""
    measurements: list[Measurement]
    robot_s: float
    """Robot time of the first query, in seconds."""


@dataclass(frozen=True, kw_only=True)
class NewcomerVerb(Verb):
    """Open the page on the demo apartment as a newcomer does, and take the time; two to five minutes."""

    def run(self) -> Summary:
        """Measure; raises LtvnError."""
        from playwright.sync_api import expect, sync_playwright

        from ltvn_viz.app import AppOptions
        from tests.browser import newcomer
        from tests.browser.chromium import chromium_path
        from tests.browser.conftest import FLAGS
        from tests.browser.running_app import running_app
        from tests.waiting import PATIENCE_MS

        load = os.getloadavg()[0]
        expect.set_options(timeout=PATIENCE_MS)
        with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
            with running_app(AppOptions(port=0, recordings=Path(folder))) as app:
                measurements = _first_minutes(app, browser)
                robot_s = newcomer.first_query_s(app)
            browser.close()
        return NewcomerSummary(os.cpu_count() or 1, load, measurements, robot_s)


def _first_minutes(app: "RunningApp", browser: "Browser") -> list[Measurement]:
    """Time what the newcomer sees. The page draws no scene, which without a graphics card takes most of the time."""
    from tests.browser import newcomer
    from tests.browser.pages import open_page

    opened = time.monotonic()
    with open_page(browser, app.server.url, width=WINDOW[0], height=WINDOW[1], draws=False) as page:
        newcomer.reach_first_goal(app, page)
        goal_s = time.monotonic() - opened
        newcomer.begin_story(page)
        begun = time.monotonic()
        newcomer.wait_for_mark(page, newcomer.NEW)
        new_s = time.monotonic() - begun
        newcomer.wait_for_mark(page, newcomer.FADED)
        faded_s = time.monotonic() - begun
    return [
        measured("open page to first goal", goal_s, "s", at_most=GOAL_S),
        measured("story to a new edge", new_s, "s", at_most=LEARNING_S),
        measured("story to a faded edge", faded_s, "s", at_most=LEARNING_S),
    ]


if __name__ == "__main__":
    sys.exit(run_verb("python -m benchmarks.newcomer", NewcomerVerb))
