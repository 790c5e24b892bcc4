"""The network learns a place from a drive, in a real browser: shipped network, simulated apartment, a few steps."""

import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from ltvn_core.data.recording.info import read_info
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData
from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs
from ltvn_core.network.weights_file import read_card, weights_fingerprint
from ltvn_core.training.fine_tuning_data import ProgressReporter
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.fine_tuner import FineTuner
from ltvn_viz.timeline.run_moment import moment_of
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import press
from tests.browser.pages import open_page
from tests.browser.running_app import running_app
from tests.viz.tiny_fine_tuning import PLAN, TinyRehearsal
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser


@dataclass(frozen=True)
class HeldRehearsal(TinyRehearsal):
    """Tiny simulated data that come when a test lets them, so that the page has shown before that they are awaited."""

    may_come: threading.Event = field(default_factory=threading.Event)

    def load(
        self, drive: TrajectoryPairs, on_progress: ProgressReporter, *, with_validation_drives: bool
    ) -> FineTuningData:
        on_progress(0.5, "looking at boxes")
        assert self.may_come.wait(PATIENCE_S)
        return super().load(drive, on_progress, with_validation_drives=with_validation_drives)


REHEARSAL = HeldRehearsal()
FEW_STEPS = FineTuner(plan=replace(PLAN, learning=replace(PLAN.learning, rate=1e-5)), rehearsal=REHEARSAL)


@pytest.fixture(autouse=True)
def held() -> Iterator[None]:
    """Hold the data, and let nobody wait for them after the test."""
    REHEARSAL.may_come.clear()
    yield
    REHEARSAL.may_come.set()


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    options = AppOptions(
        port=0, scene="tune-0", recordings=tmp_path_factory.mktemp("recordings"), seed=1, tuner=FEW_STEPS
    )
    with running_app(options) as app:
        yield app


@pytest.fixture(scope="module")
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    """The page of somebody who has just kept the recording of a short drive."""
    with open_page(chromium, app.server.url, width=1000, height=760, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        record(app, page, lambda: moment_of(app.session.state.live.timeline).frames > 120)
        yield page


def button(page: Page, name: str) -> Locator:
    return page.get_by_role("button", name=re.compile(f"^{name}"))


def record(app: RunningApp, page: Page, holds: Callable[[], bool]) -> None:
    """Record while the robot turns and drives by turns, until something holds."""
    last_recording = app.session.state.last_recording
    press(page, "Record", lambda: app.session.state.live.recorder.is_on)

    def drive_on() -> None:
        for key in "wa":  # Anew each time: a page that stalled for longer than the lease has lost it.
            page.keyboard.down(key)
            page.wait_for_timeout(1200)
            page.keyboard.up(key)

    until(holds, meanwhile=drive_on, explain=lambda: f"turned too little: {app.server.seat.state_of(1)}")
    press(page, "Keep", lambda: app.session.state.last_recording != last_recording)


def weights_in(app: RunningApp) -> set[str]:
    return {path.name for path in app.session.state.library.folder.glob("*.safetensors")}


def test_a_short_drive_is_recorded_and_offered_to_learn_from(app: RunningApp, page: Page) -> None:
    expect(page.get_by_text(f"learn this place from {app.session.state.last_recording}")).to_be_visible()


def test_learning_is_seen_and_stopped(app: RunningApp, page: Page) -> None:
    before = weights_in(app)
    button(page, "Learn from this drive").click()
    expect(page.get_by_role("progressbar")).to_be_visible()
    button(page, "Stop learning").click()
    until(lambda: app.session.state.fine_tuning.status.doing == "stopping")
    REHEARSAL.may_come.set()
    expect(page.get_by_text("Stopped; the network is as it was.")).to_be_visible()
    assert weights_in(app) == before


def test_a_whole_fine_tuning_changes_nothing_until_its_weights_are_used_for_a_new_map(
    app: RunningApp, page: Page
) -> None:
    before = weights_in(app)
    button(page, "Learn from this drive").click()
    expect(page.get_by_role("progressbar")).to_have_attribute("aria-valuenow", re.compile("[1-9]"))
    REHEARSAL.may_come.set()
    button(page, "Use these weights").wait_for()
    expect(page.get_by_text(re.compile("Here: false links .* waypoint error .* cm"))).to_be_visible()
    [name] = weights_in(app) - before
    weights = app.session.state.library.folder / name
    expect(page.get_by_text(name)).to_be_visible()
    assert read_card(weights)["recording"] == app.session.state.last_recording
    assert app.session.state.live_map.fingerprint == weights_fingerprint(SHIPPED_WEIGHTS)

    button(page, "Use these weights").click()

    until(lambda: app.session.state.live_map.fingerprint == weights_fingerprint(weights))
    until(lambda: app.session.state.activity.mode is Mode.TELEOP)
    expect(page.get_by_text(f"weights {weights_fingerprint(weights)}").first).to_be_visible()
    shown = moment_of(app.session.state.live.timeline).graph.ids.tolist()
    assert shown == list(app.session.state.live_map.graph.nodes) != []
    record(app, page, lambda: app.session.state.live.recorder.status.frames > 3)
    assert read_info(
        app.session.state.library.path(app.session.state.last_recording or "")
    ).fingerprint == weights_fingerprint(weights)
