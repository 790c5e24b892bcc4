"""The command line as a user meets it: real processes, real files, clear errors."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import BenchSummary
from benchmarks.measurement import measured
from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.verbs.verb import to_text
from tests.core.data.recording import example_recording
from tests.core.simulation.two_room_mesh import box_house, save
from tests.platforms import needs_posix
from tests.program import ltvn_here, skip_without_library
from tests.repository import DEMO_MAP

pytestmark = pytest.mark.slow


def ltvn(*arguments: str | Path, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run a command; skip the test where what it needs is not installed."""
    run = subprocess.run(
        [sys.executable, "-m", "ltvn_core.cli", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=280,
    )
    skip_without_library(run.stderr)
    return run


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    example_recording.write(tmp_path / "drive.rrd")
    return tmp_path / "drive.rrd"


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        (("navigte",), "Did you mean navigate?"),
        (("collect", "--scene", "dmo", "--output", "never.rrd"), "Did you mean demo?"),
        (("lifelong", "--world", "dors"), "Did you mean doors?"),
        (("app", "--port", "99999"), "--port must be from 1 to 65535"),
    ],
)
def test_a_slip_of_the_fingers_is_said_with_what_was_meant(
    typed: tuple[str, ...], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = ltvn_here(capsys, *typed)
    assert run.code in {1, 2}
    assert meant in run.stderr


def test_an_unknown_verb_or_option_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert ltvn("fly").returncode == 2
    assert ltvn_here(capsys, "demo", "--headles").code == 2
    assert ltvn_here(capsys, "demo", "--preset", "bold").code == 2


def test_a_summary_is_text_for_a_person_and_json_for_a_program(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "frames" in ltvn_here(capsys, "verify", drive).stdout
    summary = json.loads(ltvn("info", drive, "--json", "-").stdout)
    assert (summary["frames"], summary["nodes"]) == (10, 3)
    assert ltvn_here(capsys, "info", drive, "--json", tmp_path / "info.json").code == 0
    assert json.loads((tmp_path / "info.json").read_text(encoding="utf-8")) == summary


@pytest.mark.parametrize("name", ["drive.rrd", "notes.txt"])
def test_a_summary_never_replaces_a_file_of_another_kind(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / "notes.txt").write_text("my notes", encoding="utf-8")
    before = (tmp_path / name).read_bytes()
    ran = ltvn_here(capsys, "info", drive, "--json", tmp_path / name)
    assert ran.code == 1
    assert "is no summary, so it is kept" in ran.stderr
    assert (tmp_path / name).read_bytes() == before
    for _ in range(2):
        assert ltvn_here(capsys, "info", drive, "--json", tmp_path / "info.json").code == 0


def test_several_recordings_are_verified_each_by_itself(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(drive.read_bytes()[:-100])

    assert ltvn_here(capsys, "verify", drive, drive).code == 0
    ran = ltvn_here(capsys, "verify", drive, cut, drive)
    told = json.loads(ltvn_here(capsys, "verify", drive, cut, drive, "--json", "-").stdout)

    assert ran.code == 1
    assert ran.stdout.count("frames ") == 2
    assert "ltvn repair" in ran.stdout
    assert [each.get("frames") for each in told] == [10, None, 10]
    both = json.loads(ltvn_here(capsys, "info", drive, drive, "--json", "-").stdout)
    assert [each["frames"] for each in both] == [10, 10]
    assert ltvn_here(capsys, "verify").code == 1


@needs_posix
def test_a_figure_goes_whole_and_alone_to_the_standard_output(tmp_path: Path) -> None:
    figure = tmp_path / "map.svg"
    with figure.open("w") as file:
        subprocess.run(
            [sys.executable, "-m", "ltvn_core.cli", "export", str(DEMO_MAP), "--svg", "/dev/stdout"],
            stdout=file,
            check=True,
        )
    text = figure.read_text(encoding="utf-8")
    assert text.startswith("<svg")
    assert text.rstrip().endswith("</svg>")


def test_rows_of_a_summary_get_a_line_each() -> None:
    rows = [measured("seek", 0.8, "ms", at_most=100), measured("recolour", 296, "kB", at_most=400)]
    _, first, second = to_text(BenchSummary("a laptop", rows)).split("\n  (")
    assert first.startswith("name seek, value 0.8, unit ms")
    assert second.startswith("name recolour, value 296, unit kB")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("verify", "missing.rrd"), "missing.rrd"),
        (("replay", "missing.rrd"), "missing.rrd"),
        (("collect", "--scene", "castle", "--output", "x.rrd"), "apartment-57"),
        (("build", "missing.rrd", "--output", "map.rrd"), "missing.rrd"),
        (("navigate", "missing.rrd", "--recording", "x.rrd"), "missing.rrd"),
        (("navigate", "drive.rrd", "--recording", "x.rrd", "--goal", "1", "--queries", "2"), "--queries"),
        (("lifelong", "--every", "0"), "every 0"),
        (("demo", "--headless", "--queries", "-1"), "--queries"),
        (("collect", "--scene", "demo", "--loops", "0", "--output", "x.rrd"), "--loops"),
        (("build", "drive.rrd", "--output", "map.rrd", "--weights", "drive.rrd"), "drive.rrd"),
    ],
)
def test_a_mistake_ends_with_one_clear_line(
    arguments: tuple[str, ...],
    says: str,
    drive: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(drive.parent)
    run = ltvn_here(capsys, *arguments)
    last = run.stderr.strip().splitlines()[-1]
    assert run.code == 1
    assert last.startswith("ltvn: ")
    assert says in last
    assert "Traceback" not in run.stderr


def test_what_cannot_end_well_is_said_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken, trip = tmp_path / "taken.rrd", tmp_path / "trip.rrd"
    taken.touch()
    strange = ltvn_here(capsys, "navigate", DEMO_MAP, "--recording", trip, "--goal", "5")
    assert "has no node 5" in strange.stderr
    assert "exists already" in ltvn_here(capsys, "navigate", DEMO_MAP, "--recording", trip, "--output", taken).stderr
    for verb in (("build", DEMO_MAP), ("collect", "--loops", "1")):
        assert "exists already" in ltvn_here(capsys, *verb, "--output", taken).stderr
    assert not taken.read_bytes()
    assert [*tmp_path.iterdir()] == [taken]
    assert "not a folder" in ltvn_here(capsys, "export", DEMO_MAP, "--svg", taken / "map.svg").stderr


def test_collect_build_navigate_in_one_go_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tour, built, trip = (tmp_path / name for name in ("tour.rrd", "map.rrd", "trip.rrd"))
    house = save(box_house(), tmp_path / "house.glb")
    collected = json.loads(ltvn("collect", "--scene", house, "--loops", "1", "--output", tour, "--json", "-").stdout)
    assert collected["frames"] == len(Recording.open(tour).frames)
    options = "--output", built, "--predictor", "oracle", "--json", "-"
    summary = json.loads(ltvn_here(capsys, "build", tour, *options).stdout)
    assert summary["nodes"] > 20
    assert summary["edges"] > summary["nodes"]
    learned = tmp_path / "learned.rrd"
    options = "--queries", "2", "--output", learned, "--predictor", "oracle", "--json", "-"
    run = ltvn_here(capsys, "navigate", built, "--recording", trip, *options)
    assert json.loads(run.stdout)["outcome"]["reached"] == 2, run.stderr
    verify(trip)
    assert any(edge.attempts for edge in load_map(learned).graph.edges.values())
    other = ltvn_here(capsys, "navigate", built, "--recording", tmp_path / "again.rrd", "--predictor", "network")
    assert other.code == 1
    assert "weights" in other.stderr
