"""Take the film at the head of the README: a goal is clicked, the robot drives, a door closes, the map learns.

    python -m tests.browser.story_film [FOLDER]

Needs Chromium. The robot's time goes on only between two pictures, so that they are as smooth on a slow machine as on
a fast one. With a folder, the pictures are kept there too. Owns what is done on the page, and how long each picture
stays.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image
from playwright.sync_api import Locator, Page, ViewportSize, sync_playwright

from ltvn_viz.app import AppOptions, RunningApp, open_app
from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.wishes.modes import Mode
from tests.browser.chromium import chromium_path
from tests.browser.conftest import FLAGS
from tests.browser.pages import open_page, wait_until_drawn
from tests.browser.screenshots import shown
from tests.repository import ROOT
from tests.waiting import until

OUTPUT = ROOT / "docs" / "images" / "film.webp"
WINDOW: ViewportSize = {"width": 1280, "height": 800}
WIDTH_PX = 1024
QUALITY = 60
"""Of 100."""
GOAL = 0
"""The image of the gallery that is clicked."""
QUERY_EVERY_S, STORY_EVERY_S = 1.5, 4.0
"""Robot time between two pictures."""
MOVING_MS, CLICKING_MS, READING_MS, ENDING_MS = 200, 900, 1200, 3000
"""How long a picture stays: while the robot drives, where something is clicked, where a caption is new, at the end."""
_PATIENT_S = 120.0
"""A page that is drawn by software falls silent for long."""
_POINTER = """([x, y]) => {
  const pointer = document.getElementById("film-pointer") ?? document.createElement("div");
  pointer.id = "film-pointer";
  pointer.style.cssText = `position:fixed;left:${x - 14}px;top:${y - 14}px;width:28px;height:28px;z-index:9999;
    border-radius:50%;border:3px solid #ffd43b;background:#ffd43b55;pointer-events:none`;
  document.body.append(pointer);
}"""
_STYLE = ".mantine-Notification-root {display: none !important} .lt-health {visibility: hidden}"
"""Captions stand in the panel too; and how well the app keeps up means nothing where time waits for pictures."""
_NO_POINTER = "document.getElementById('film-pointer')?.remove()"


@dataclass
class Film:
    """The pictures so far, and the page that they show."""

    app: RunningApp
    page: Page
    folder: Path
    pictures: list[tuple[Path, int]] = field(default_factory=list)
    """Each with how many milliseconds it stays."""

    def take(self, stays_ms: int) -> None:
        """Take a picture of the page as it is now."""
        wait_until_drawn(self.page)
        path = self.folder / f"{len(self.pictures):03}-{stays_ms}.png"
        shown(self.page).save(path)
        self.pictures.append((path, stays_ms))
        sys.stdout.write(f"\r{len(self.pictures)} pictures, {self.now_s:.0f} s of robot time ")
        sys.stdout.flush()

    def click(self, what: Locator) -> None:
        """Take a picture of the pointer on something, click it, and take one of what comes of it."""
        self.tick_until(what.is_visible)
        box = what.bounding_box()
        assert box is not None
        self.page.evaluate(_POINTER, [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
        self.take(CLICKING_MS)
        what.click()
        self.page.evaluate(_NO_POINTER)

    @property
    def now_s(self) -> float:
        """Robot time."""
        return self.app.session.state.live.now_s

    def tick(self) -> None:
        """Let the session go on by one tick, which waits for thoughts rather than for the time."""
        self.app.session.tick()
        self.app.session.state.worker.wait(1.0)

    def tick_until(self, holds: Callable[[], bool]) -> None:
        """Let the session go on until something holds."""
        until(holds, meanwhile=self.tick)

    def play(self, every_s: float, ends: Callable[[], bool], is_news: Callable[[], bool]) -> None:
        """Take a picture whenever so much robot time has passed, and whenever there is news to be read."""
        due_s = self.now_s
        while not ends():
            self.tick()
            is_new = is_news()
            if is_new or self.now_s >= due_s:
                self.take(READING_MS if is_new else MOVING_MS)
                due_s = self.now_s + every_s


def main(arguments: Sequence[str]) -> int:
    """Play, and write the film."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(arguments[0]) if arguments else Path(folder)
        kept.mkdir(parents=True, exist_ok=True)
        with _opened(kept) as film:
            _send_to_a_goal(film)
            _watch_it_learn(film)
        write_film(film.pictures, OUTPUT)
    return 0


@contextmanager
def _opened(folder: Path) -> Iterator[Film]:
    options = AppOptions(port=0, recordings=folder / "recordings", seed=1)
    seat = DriverSeat(lease_s=_PATIENT_S)
    with open_app(options, seat=seat) as app, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        app.session.tick()
        try:
            with open_page(browser, app.server.url, **WINDOW) as page:
                page.get_by_text("Next:").wait_for()
                page.add_style_tag(content=_STYLE)
                yield Film(app, page, folder)
        finally:
            app.session.close()
            browser.close()


def _send_to_a_goal(film: Film) -> None:
    parts = [film.page.locator(part) for part in ("#ltvn-caption", "#ltvn-legend")]
    film.tick_until(lambda: all(each.inner_text() for each in parts))
    film.take(CLICKING_MS)
    film.click(film.page.get_by_role("tab", name="Go"))
    film.click(film.page.locator(".lt-gallery img").nth(GOAL))
    film.tick_until(lambda: film.app.session.state.activity.mode is Mode.NAVIGATING)
    film.play(QUERY_EVERY_S, lambda: film.app.session.state.activity.mode is Mode.TELEOP, lambda: False)
    film.take(READING_MS)


def _watch_it_learn(film: Film) -> None:
    film.click(film.page.get_by_role("tab", name="World"))
    film.click(film.page.get_by_role("button", name="Watch it learn"))
    state, told = film.app.session.state, 0
    film.tick_until(lambda: state.story is not None)
    story = state.story
    assert story is not None

    def is_news() -> bool:
        nonlocal told
        before, told = told, len(story.captions)
        return told > before

    film.play(STORY_EVERY_S, lambda: story.is_over, is_news)
    film.tick()
    film.take(ENDING_MS)


def write_film(pictures: Sequence[tuple[Path, int]], output: Path) -> None:
    """Write pictures, each with how many milliseconds it stays, as an animated WebP that repeats."""
    images = [_small(Image.open(path)) for path, _ in pictures]
    images[0].save(
        output,
        "WEBP",
        save_all=True,
        append_images=images[1:],
        duration=[stays_ms for _, stays_ms in pictures],
        loop=0,
        quality=QUALITY,
        method=4,
    )
    seconds = sum(stays_ms for _, stays_ms in pictures) / 1000
    sys.stdout.write(f"\n{output.name}: {output.stat().st_size // 1000} kB, {len(images)} pictures, {seconds:.0f} s\n")


def _small(image: Image.Image) -> Image.Image:
    return image.convert("RGB").resize((WIDTH_PX, WIDTH_PX * image.height // image.width), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
