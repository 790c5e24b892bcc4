"""The page with a recording open, and a person's hands in its “Why” tab; for the browser tests and the pictures.

Owns how one asks, clicks, types and waits. What is asked is the business of whoever uses it.
"""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import viser
from playwright.sync_api import Browser, Locator, Page, TimeoutError, ViewportSize

from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.wishes.commands import Action, Ask, AskAbout, Command, OpenRecording, PointAt, Seek
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import hold_key, wait_for_rest
from tests.browser.pages import open_page
from tests.browser.running_app import running_app
from tests.repository import RECORDINGS
from tests.waiting import PATIENCE_S, until

WINDOW: ViewportSize = {"width": 1040, "height": 680}

_TRIES = 8
LAST_S = 1e9
"""Later than any recording ends."""
_IS_SHOWN = """html => {
  const wanted = document.createElement("div");
  wanted.innerHTML = html;
  const shown = [...document.querySelectorAll("div.lt")].map(each => each.outerHTML);
  return shown.includes(wanted.firstElementChild.outerHTML);
}"""


@dataclass(frozen=True)
class DebuggerPage:
    """A page that shows a recording, its “Why” tab open."""

    app: RunningApp
    page: Page
    folder: Path
    """The recordings folder; files that the page makes go there."""

    @property
    def answer(self) -> Locator:
        """What the tool on show says."""
        return self.page.locator(".lt-why")

    def ask(self, question: QuestionName) -> Locator:
        """Choose a question of the list, and return where its answer will stand."""
        if self.shown.question is not question:
            press_question(self.page, question)
            self.until(lambda: self.shown.question is question)
        return self.settled()

    def questions(self) -> list[QuestionName]:
        """Return the questions on offer."""
        # Read at once, because the list may be drawn anew at any time.
        offered = self.page.locator(".lt-question").evaluate_all("all => all.map(each => each.dataset.text)")
        return [question for question in QuestionName if question.value in offered]

    def follow(self, label: str | re.Pattern[str]) -> None:
        """Click the first link whose whole label is this, and wait until the page has answered."""
        self.settled()  # What an older view said may be meant otherwise than what the app says now.
        before, link = self.shown, self.link(label)
        command = self.app.session.state.debugger.link(int(link.get_attribute("data-id") or -1))
        link.click()
        self.until(lambda: self._handled(command, before))
        self.settled()

    def _handled(self, command: Command | None, before: Inspection) -> bool:
        if isinstance(command, Ask | AskAbout):
            return self.shown.question == (command.value if isinstance(command, Ask) else command.question)
        if isinstance(command, PointAt):
            edge, node = self.shown.selection.edge, self.shown.selection.node
            return node == command.node if command.target is None else edge == (command.node, command.target)
        return self.shown is not before

    def link(self, label: str | re.Pattern[str]) -> Locator:
        """Return the first link with this label."""
        whole = re.compile(f"^{re.escape(label)}$") if isinstance(label, str) else label
        return self.answer.locator("a, .lt-next", has_text=whole).first

    def go_to_the_robot(self) -> None:
        """Leave the recording, if one is open, and wait until the map is whole."""
        if self.is_replay:
            self.app.session.send(Ask(Action.CLOSE))
            self.until(lambda: not self.is_replay)
        wait_for_rest(self.app)

    def go_to_failure(self, query: int) -> str:
        """Ask at the end of the recording what failed, click the moment of a query, and return what is said there."""
        self.app.session.send(Seek(LAST_S))
        self.until(lambda: self.seconds > 0)
        self.ask(QuestionName.FAILURES)
        self.says("queries failed")
        self.answer.locator("table", has_text="cause").locator("tbody tr").nth(query).locator("a").first.click()
        return self.says(f"Later in this recording: query {query}")

    def go_to_the_recording(self, name: str) -> None:
        """Open a recording unless it is open already, with the “Why” tab before it."""
        if not self.is_replay:
            self.app.session.send(OpenRecording(name))
            self.until(lambda: self.is_replay)
        self.page.get_by_role("tab", name="Why").click()

    def compare_with(self, other: str) -> None:
        """Compare the map with that of another file, whichever one was chosen before."""
        self.ask(QuestionName.COMPARE)
        if "choose another" in self.shown.html:
            self.follow("choose another")
        self.follow(other)

    def cut_what_differs(self, other: str) -> None:
        """At the robot, compare its map with another one, and cut the first edge that differs by hand."""
        self.go_to_the_robot()
        self.compare_with(other)
        self.says("believed differently")
        self.answer.locator("table").nth(1).locator("a").first.click()
        self.says("its images and attempts")
        self.ask(QuestionName.HAND)
        self.follow(re.compile("^cut "))
        self.says("undo")

    def tell(self, text: str) -> None:
        """Type something into the tool's field and press the button beside it."""
        before = self.shown
        field = self.page.locator("input:not([readonly]):visible, textarea:visible").last
        field.fill(text)
        self.page.get_by_role("button", name=before.verb, exact=True).click()
        self.until(lambda: self.shown is not before)
        self.settled()

    def settled(self) -> Locator:
        """Wait until the page shows what the app says, and return it."""
        self.until(lambda: (html := self.shown.html) != "" and self.page.evaluate(_IS_SHOWN, html))
        return self.answer

    def says(self, *words: str, patience_s: float = PATIENCE_S) -> str:
        """Wait until the answer has all these words in it and is at work no more, and return it as text."""
        self.until(
            lambda: all(word in self.shown.html for word in words) and not self.shown.answer.is_pending,
            patience_s=patience_s,
        )
        return self.settled().inner_text()

    def until(self, holds: Callable[[], bool], *, patience_s: float = PATIENCE_S) -> None:
        """Wait until something holds in the app."""
        until(
            holds,
            patience_s=patience_s,
            meanwhile=lambda: self.page.wait_for_timeout(50),
            explain=self.answer.inner_text,
        )

    def drive(self, key: str, holds: Callable[[], bool]) -> None:
        """Hold a key until something holds in the app."""
        hold_key(self.app, self.page, key, holds)

    def link_to_share(self, words: str) -> str:
        """Wait until the link of “Show somebody” has these words in it, and return its address."""
        link = self.answer.locator(f'a[href*="{words}"]')
        link.wait_for()
        return link.get_attribute("href") or ""

    def open_link(self, address: str) -> None:
        """Open a link in place of the page, as whoever got it does."""
        before = set(self._clients)
        self.page.goto(self.app.server.link(address.removeprefix("/?")))
        self.until(lambda: len(self._clients) == 1 and not before & set(self._clients))
        self.page.get_by_role("tab", name="Why").click()

    @property
    def _clients(self) -> dict[int, viser.ClientHandle]:
        return self.app.server.viser.get_clients()

    @property
    def seconds(self) -> float:
        """Where in the recording the page is."""
        activity = self.app.session.state.activity
        assert isinstance(activity, Playback)
        return activity.time_s

    @property
    def is_replay(self) -> bool:
        """Tell whether the recording is on show, not the robot."""
        return self.app.session.state.activity.mode is Mode.REPLAY

    @property
    def is_playing(self) -> bool:
        """Tell whether the recording runs."""
        activity = self.app.session.state.activity
        return isinstance(activity, Playback) and activity.playing

    @property
    def shown(self) -> Inspection:
        """What the app shows in the tab."""
        return self.app.session.state.debugger.shown


def press_question(page: Page, question: QuestionName) -> None:
    """Press the button of a question, in the row or under “More”, which closes when the list is drawn anew."""
    button = page.locator(f'.lt-question[data-text="{question}"]')
    button.wait_for(state="attached")
    for _ in range(_TRIES):
        if not button.is_visible():
            page.locator(".lt-asks summary").click()
        with suppress(TimeoutError):
            return button.click(timeout=1e3 * PATIENCE_S / _TRIES)
    raise AssertionError(f"{question} cannot be pressed")


@contextmanager
def open_debugger(
    chromium: Browser, folder: Path, name: str, *, at_s: float = 0.0, draws: bool = True
) -> Iterator[DebuggerPage]:
    """Open a page on a copy of a shipped recording, the other one beside it, with the “Why” tab open."""
    for path in RECORDINGS.glob("demo-*.rrd"):
        shutil.copy(path, folder)
    options = AppOptions(port=0, map=folder / "demo-map.rrd", recordings=folder, replay=name, replay_at_s=at_s)
    with running_app(options) as app, open_page(chromium, app.server.url, **WINDOW, draws=draws) as page:
        page.get_by_role("tab", name="Why").click()
        debugger = DebuggerPage(app, page, folder)
        debugger.until(lambda: app.session.state.activity.mode is Mode.REPLAY)
        yield debugger
