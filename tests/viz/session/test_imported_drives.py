"""Drives of real cameras in the page, which has no simulator and no robot for them."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from shutil import copy, copytree

import numpy as np
import pytest

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.navigation.events import Severity
from ltvn_core.preprocessing import preprocess_image
from ltvn_core.types import Rgb
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.options import AppOptions
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.core.data.importing.drives import EXCERPT
from tests.viz.app_session import AppSession
from tests.viz.session_harness import said

DRIVE = "tour.rrd"


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("imported") / DRIVE
    import_drive(open_drive(EXCERPT), path)
    return path


@pytest.fixture
def folder(tmp_path: Path, drive: Path) -> Path:
    return Path(copy(drive, tmp_path)).parent


@pytest.fixture
def page(folder: Path) -> Iterator[AppSession]:
    """A session that watches a drive of a folder, as `ltvn replay` opens it."""
    with ExitStack() as stack:
        page = AppSession(stack, AppOptions(scene="real:tum_excerpt", recordings=folder, replay=DRIVE))
        page.do(c.OpenRecording(DRIVE))
        page.until(lambda now: now.replay is not None)
        yield page


def test_an_imported_drive_shows_its_whole_way_and_the_camera_that_took_it(page: AppSession) -> None:
    now = page.do(c.Seek(0.0))
    assert now.mode is Mode.REPLAY
    assert now.moment.frames == 1
    assert len(now.course) == len(page.state.shown_run.frames) > 5
    assert now.lone_camera is not None
    assert now.lone_camera.width == 320
    assert page.do(c.Ask(c.Action.CLOSE)).lone_camera is None


def test_only_what_has_weights_is_offered_to_learn(page: AppSession) -> None:
    assert page.now.weights.startswith("geometric")
    assert not page.now.fine_tuning.is_possible


def test_a_drive_in_another_format_is_offered_imported_and_opened(page: AppSession, folder: Path) -> None:
    copytree(EXCERPT, folder / "a drive")
    (folder / "notes.txt").write_text("no drive", encoding="utf-8")
    now = page.until(lambda now: now.sources == ("a drive",))
    assert page.do(c.Ask(c.Action.IMPORT, "a drive")).is_making
    now = page.until(lambda now: now.replay == "a drive.rrd")
    assert "images" in said(now)


def test_nothing_is_imported_but_what_is_listed(page: AppSession, folder: Path) -> None:
    (folder / "notes.txt").write_text("no drive", encoding="utf-8")
    for name in ("../elsewhere", "notes.txt", DRIVE, ""):
        page.state.message = None
        now = page.do(c.Ask(c.Action.IMPORT, name))
        assert "There is no drive" in said(now)
        assert not now.is_making


def test_a_drive_that_cannot_be_read_is_one_clear_line_and_leaves_nothing(page: AppSession, folder: Path) -> None:
    (folder / "broken.mcap").write_bytes(b"no bag at all")
    page.do(c.Ask(c.Action.IMPORT, "broken.mcap"))
    now = page.until(lambda now: not now.is_making and now.message is not None)
    assert now.message is not None
    assert now.message.severity is Severity.ERROR
    assert "broken.mcap" in now.message.text
    assert "\n" not in now.message.text
    assert now.replay == DRIVE
    assert sorted(path.name for path in folder.iterdir()) == ["broken.mcap", DRIVE]


def test_one_recording_is_made_at_a_time_and_can_be_given_up(page: AppSession, folder: Path) -> None:
    page.do(c.Ask(c.Action.BUILD))
    now = page.do(c.Ask(c.Action.BUILD))
    assert "not done yet" in said(now)
    page.do(c.Ask(c.Action.CANCEL))
    now = page.until(lambda now: not now.is_making and now.message is not None)
    assert "cancelled" in said(now)
    assert [path.name for path in folder.iterdir()] == [DRIVE]


def test_a_map_is_built_from_an_open_drive_without_a_simulator_and_pictures_are_looked_for_in_it(
    page: AppSession,
) -> None:
    assert page.do(c.Ask(c.Action.BUILD)).is_making
    now = page.until(lambda now: now.replay == "tour-map.rrd")
    assert "tour-map.rrd" in page.state.library.names()
    assert "by geometric" in said(now)
    nodes = page.do(c.Seek(1e9)).moment.graph.ids
    assert len(nodes) >= 2
    assert not page.now.is_making
    node = int(nodes.min())  # The camera turns fast later on, and its images blur.
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
    assert "not taken in this map" in said(now)


def test_a_picture_cannot_be_found_where_there_is_no_map(page: AppSession) -> None:
    page.do(look_for(np.zeros((240, 320, 3), np.uint8)))
    now = page.until(lambda now: now.work is None and now.message is not None)
    assert now.message is not None
    assert now.message.severity is Severity.ERROR
    assert "map" in now.message.text
    assert now.mode is Mode.REPLAY


def look_for(rgb: Rgb) -> c.NavigateToImage:
    """Return what an upload of such an image asks for."""
    return c.NavigateToImage(preprocess_image(rgb, "upload"), rgb)
