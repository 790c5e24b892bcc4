"""Drives of real cameras in the page, which has no simulator and no robot for them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from ltvn_core.importing.drive_import import import_drive
from ltvn_core.importing.reader_registry import open_drive
from ltvn_viz.app_setup import open_app_state
from ltvn_viz.server.thumbnails import ThumbnailStore
from ltvn_viz.session import commands as c
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from tests.core.importing.drives import EXCERPT
from tests.viz.session_harness import FakeDriver
from tests.waiting import until

DRIVE = "tour.rrd"


class Page:
    """A session that watches a drive of a folder, as `ltvn replay` opens it."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        options = AppOptions(scene="real:tum_excerpt", recordings=folder, replay=DRIVE)
        self.state = open_app_state(options, stack, ThumbnailStore())
        self.shown: list[Snapshot] = []
        self.session = Session(self.state, FakeDriver(), self.shown.append)
        stack.callback(self.session.close)
        self.do(c.OpenRecording(DRIVE))
        self.until(lambda now: now.replay is not None)

    def do(self, command: c.Command) -> Snapshot:
        self.session.send(command)
        self.session.tick()
        return self.shown[-1]

    def until(self, holds: Callable[[Snapshot], bool]) -> Snapshot:
        self.session.tick()
        until(lambda: holds(self.shown[-1]), meanwhile=self.session.tick, explain=lambda: self.shown[-1])
        return self.shown[-1]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    import_drive(open_drive(EXCERPT), tmp_path / DRIVE)
    return tmp_path


@pytest.fixture
def page(folder: Path) -> Iterator[Page]:
    with ExitStack() as stack:
        yield Page(folder, stack)


def test_an_imported_drive_shows_its_whole_way_and_the_camera_that_took_it(page: Page) -> None:
    now = page.do(c.Seek(0.0))
    assert now.mode is Mode.REPLAY
    assert now.moment.frames == 1
    assert len(now.course) == len(page.state.shown_run.frames) > 5
    assert now.lone_camera is not None
    assert now.lone_camera.width == 320
    assert page.do(c.CloseRecording()).lone_camera is None


def test_only_what_has_weights_is_offered_to_learn(page: Page) -> None:
    assert page.shown[-1].weights.startswith("geometric")
    assert not page.shown[-1].fine_tuning.is_possible
