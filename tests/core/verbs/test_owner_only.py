"""What a verb writes is for its owner alone, whatever the umask: it shows rooms, as recordings do."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from ltvn_core.cli import main
from tests.core.data.importing.drives import write_tum_folder
from tests.core.data.recording import example_recording
from tests.core.evaluation.reports.fake_results import keep, make_trial, run_of
from tests.platforms import needs_posix
from tests.repository import DEMO_MAP

pytestmark = needs_posix


@pytest.fixture(params=[0o022, 0o000], autouse=True)
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def check_private(path: Path) -> None:
    made = [path, *path.rglob("*")]
    assert path.exists()
    for each in made:
        assert each.stat().st_mode & 0o777 == (0o700 if each.is_dir() else 0o600), each


@pytest.mark.parametrize(("to", "name"), [("mcap", "bag"), ("mcap", "one.mcap"), ("tum", "desk"), ("vint", "hall")])
def test_an_exported_drive_is_for_its_owner(tmp_path: Path, to: str, name: str) -> None:
    example_recording.write(tmp_path / "drive.rrd")
    assert main(["export", str(tmp_path / "drive.rrd"), "--to", to, "--output", str(tmp_path / "new" / name)]) == 0
    check_private(tmp_path / "new")


@pytest.mark.parametrize("options", [["--to", "graphml", "--output", "new/map.graphml"], ["--svg", "new/map.svg"]])
def test_an_exported_map_is_for_its_owner(tmp_path: Path, options: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(DEMO_MAP), *options]) == 0
    check_private(tmp_path / "new")


def test_a_report_and_a_summary_are_for_their_owner(tmp_path: Path) -> None:
    keep(tmp_path / "results", run_of(make_trial()))
    report, summary = tmp_path / "new/report.html", tmp_path / "summary.json"
    assert main(["report", str(tmp_path / "results"), "--output", str(report), "--json", str(summary)]) == 0
    check_private(tmp_path / "new")
    check_private(summary)


def test_an_imported_drive_is_for_its_owner(tmp_path: Path, umask: int) -> None:
    folder = write_tum_folder(tmp_path / "desk")
    assert main(["import", str(folder), "--output", str(tmp_path / "new/desk.rrd"), "--fov", "60"]) == 0
    check_private(tmp_path / "new")
    assert os.umask(umask) == umask, "what a program does afterwards is its own affair"
