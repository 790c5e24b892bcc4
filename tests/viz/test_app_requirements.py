"""What makes the app impossible is said before anybody gets a link."""

from pathlib import Path

import pytest

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import LtvnError, MissingLibraryError, SceneError
from ltvn_core.verbs.build import BuildVerb
from ltvn_viz.app import AppOptions, check_requirements
from tests.core.data.importing.drives import EXCERPT
from tests.repository import RECORDINGS

MAP = RECORDINGS / "demo-map.rrd"


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the page's own libraries are installed."""
    missing = ("torch", "safetensors", "embreex")
    monkeypatch.setattr("ltvn_core.extras.find_spec", lambda name: None if name in missing else name)


def test_an_unknown_scene_is_said() -> None:
    with pytest.raises(SceneError, match="nowhere"):
        check_requirements(AppOptions(scene="nowhere"))


@pytest.mark.parametrize("options", [AppOptions(), AppOptions(map=MAP), AppOptions(predictor="network", robot="any")])
@pytest.mark.usefixtures("bare")
def test_missing_libraries_are_said(options: AppOptions) -> None:
    with pytest.raises(MissingLibraryError, match="network"):
        check_requirements(options)


@pytest.mark.usefixtures("bare")
def test_to_watch_a_recording_nothing_more_is_needed() -> None:
    check_requirements(AppOptions(replay="demo-fault.rrd", scene="nowhere"))


def test_a_map_that_is_not_there_is_said() -> None:
    with pytest.raises(LtvnError):
        check_requirements(AppOptions(map=Path("nowhere.rrd")))


@pytest.mark.parametrize("place", ["", "kitchen"])
def test_a_map_of_an_imported_drive_says_how_to_watch_it_instead_of_listing_scenes(tmp_path: Path, place: str) -> None:
    import_drive(open_drive(EXCERPT), tmp_path / "drive.rrd", ImportOptions(scene=place))
    known = tmp_path / "a map.rrd"
    BuildVerb(recordings=(tmp_path / "drive.rrd",), output=known).run()
    with pytest.raises(SceneError) as refused:
        check_requirements(AppOptions(map=known))
    assert f"`ltvn replay '{known}'`" in str(refused.value)
    assert "--robot" in str(refused.value)
    assert "apartment" not in str(refused.value)
    check_requirements(AppOptions(map=known, robot="any"))
    check_requirements(AppOptions(replay=known.name, recordings=tmp_path))
