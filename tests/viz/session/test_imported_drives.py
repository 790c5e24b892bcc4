"""Drives of real cameras in the page, which has no simulator and no robot for them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.navigation.events import Severity
from ltvn_core.preprocessing import preprocess_image
from ltvn_core.types import Rgb
from ltvn_viz.app_opening import open_app_state
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.goals import ThumbnailStore
from ltvn_viz.session.options import AppOptions
from ltvn_viz.session.session_loop import Session
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode
from tests.core.data.importing.drives import EXCERPT
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


def test_a_map_is_built_from_an_open_drive_without_a_simulator_and_opened(page: Page) -> None:
    assert page.do(c.BuildMap()).is_making
    now = page.until(lambda now: now.replay is not None and now.replay.name == "tour-map.rrd")
    assert "tour-map.rrd" in page.state.library.names()
    assert now.message is not None
    assert "by geometric" in now.message.text
    assert len(page.do(c.Seek(1e9)).moment.graph.ids) >= 2
    assert not page.shown[-1].is_making


def test_a_drive_in_another_format_is_offered_imported_and_opened(page: Page, folder: Path) -> None:
    copytree(EXCERPT, folder / "a drive")
    (folder / "notes.txt").write_text("no drive", encoding="utf-8")
    now = page.until(lambda now: now.sources == ("a drive",))
    assert page.do(c.ImportDrive("a drive")).is_making
    now = page.until(lambda now: now.replay is not None and now.replay.name == "a drive.rrd")
    assert now.message is not None
    assert "images" in now.message.text


@pytest.mark.parametrize("name", ["../elsewhere", "notes.txt", DRIVE, ""])
def test_nothing_is_imported_but_what_is_listed(page: Page, folder: Path, name: str) -> None:
    (folder / "notes.txt").write_text("no drive", encoding="utf-8")
    now = page.do(c.ImportDrive(name))
    assert now.message is not None
    assert "There is no drive" in now.message.text
    assert not now.is_making


def test_a_drive_that_cannot_be_read_is_one_clear_line_and_leaves_nothing(page: Page, folder: Path) -> None:
    (folder / "broken.mcap").write_bytes(b"no bag at all")
    page.do(c.ImportDrive("broken.mcap"))
    now = page.until(lambda now: not now.is_making and now.message is not None)
    assert now.message is not None
    assert now.message.severity is Severity.ERROR
    assert "broken.mcap" in now.message.text
    assert "\n" not in now.message.text
    assert now.replay is not None
    assert now.replay.name == DRIVE
    assert sorted(path.name for path in folder.iterdir()) == ["broken.mcap", DRIVE]


def test_building_from_a_drive_can_be_given_up(page: Page, folder: Path) -> None:
    page.do(c.BuildMap())
    page.do(c.Cancel())
    now = page.until(lambda now: not now.is_making and now.message is not None)
    assert now.message is not None
    assert "cancelled" in now.message.text
    assert [path.name for path in folder.iterdir()] == [DRIVE]


def test_one_recording_is_made_at_a_time(page: Page) -> None:
    page.do(c.BuildMap())
    now = page.do(c.BuildMap())
    assert now.message is not None
    assert "not done yet" in now.message.text
    page.do(c.Cancel())
    page.until(lambda now: not now.is_making)


def test_a_picture_is_found_in_a_map_and_one_of_elsewhere_is_not(page: Page) -> None:
    page.do(c.BuildMap())
    page.until(lambda now: now.replay is not None and now.replay.name == "tour-map.rrd")
    node = int(page.do(c.Seek(1e9)).moment.graph.ids.min())  # The camera turns fast later on, and its images blur.
    playback = page.state.activity
    assert isinstance(playback, Playback)
    taken = playback.observation(node)
    assert taken is not None
    page.do(look_for(taken.rgb))
    now = page.until(lambda now: now.message is not None and "taken" in now.message.text)
    assert now.message is not None
    assert now.message.text.startswith(f"The image was taken at node {node}")
    assert now.selected == node
    page.do(look_for(np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)))
    now = page.until(lambda now: now.selected is None)
    assert now.message is not None
    assert "not taken in this map" in now.message.text


def test_a_picture_cannot_be_found_where_there_is_no_map(page: Page) -> None:
    page.do(look_for(np.zeros((240, 320, 3), np.uint8)))
    now = page.until(lambda now: now.work is None and now.message is not None)
    assert now.message is not None
    assert now.message.severity is Severity.ERROR
    assert "map" in now.message.text
    assert now.mode is Mode.REPLAY


def look_for(rgb: Rgb) -> c.NavigateToImage:
    """Return what an upload of such an image asks for."""
    return c.NavigateToImage(preprocess_image(rgb, "upload"), rgb)
