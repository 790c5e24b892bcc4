"""What is written: refused before the work begins where it cannot be, and cleared away after a killed process."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ltvn_core.atomic_files import atomic_output, new_folder, require_new_path
from ltvn_core.errors import RecordingError
from tests.core.data.recording import example_recording
from tests.platforms import needs_posix
from tests.program import ltvn_here
from tests.repository import ROOT

OUTPUTS = (
    "train --system sptm --output {}.safetensors",
    "build missing.rrd --output {}.rrd",
    "collect --output {}.rrd",
    "dataset --folder {}",
    "demo --headless --recording {}.rrd",
    "demo --headless --map {}.rrd",
    "evaluate --folder {}",
    "export missing.rrd --output {}.rrd",
    "export missing.rrd --html {}.html",
    "export missing.rrd --svg {}.svg",
    "export missing.rrd --to tum --output {}",
    "finetune missing.rrd --output {}.safetensors",
    "import missing --output {}.rrd",
    "info missing.rrd --json {}.json",
    "lifelong --folder {}",
    "navigate missing.rrd --recording {}.rrd",
    "navigate missing.rrd --recording trip.rrd --output {}.rrd",
    "repair missing.rrd --output {}.rrd",
    "report missing --output {}.html",
    "train --output {}.safetensors",
    "train --output new.safetensors --work {}",
)
WRITES_UNTIL_KILLED = """
import os, signal, sys
from pathlib import Path
from ltvn_core.atomic_files import atomic_output, new_folder
with {writer}(Path(sys.argv[1])) as part:
    (part if {is_file} else part / "x").write_bytes(bytes(1000))
    {end}
"""
KILL = "os.kill(os.getpid(), signal.SIGKILL)"
WAIT = "print('begun', flush=True); sys.stdin.read()"
HOLDS = [("atomic_output", True), ("new_folder", False)]


@pytest.mark.parametrize("command", OUTPUTS)
def test_an_output_that_cannot_be_written_is_refused_before_anything_is_read(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()

    below_a_file = ltvn_here(capsys, *command.format("file/x").split())
    too_long = ltvn_here(capsys, *command.format("x" * 300).split())

    assert below_a_file.code == too_long.code == 1
    assert "not a folder" in below_a_file.stderr
    assert "shorter" in too_long.stderr
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_a_name_is_refused_where_only_the_temporary_one_would_be_too_long(tmp_path: Path) -> None:
    require_new_path(tmp_path / "missing" / ("x" * 240))
    with pytest.raises(RecordingError, match="shorter"):
        require_new_path(tmp_path / ("x" * 241))
    assert [*tmp_path.iterdir()] == []


def test_a_disk_with_too_little_room_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="free some space"):
        require_new_path(tmp_path / "map.rrd", free_bytes=1 << 60)


@needs_posix
@pytest.mark.slow
def test_an_import_that_the_disk_stops_says_that_nothing_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    example_recording.write(tmp_path / "drive.rrd")
    assert ltvn_here(capsys, "export", tmp_path / "drive.rrd", "--to", "tum", "--output", tmp_path / "drive").code == 0
    program = f"ulimit -f 8; exec {sys.executable} -m ltvn_core.cli import drive --output out.rrd 2>said"

    assert subprocess.run(["bash", "-c", program], cwd=tmp_path).returncode == 1

    said = (tmp_path / "said").read_text(encoding="utf-8")
    assert "File too large" in said
    assert "nothing of it is kept" in said
    assert ".part" not in said
    assert {each.name for each in tmp_path.iterdir()} == {"drive", "drive.rrd", "said"}


@needs_posix
@pytest.mark.parametrize(("writer", "is_file"), HOLDS)
def test_what_a_killed_process_left_is_removed_by_the_next_one(tmp_path: Path, writer: str, is_file: bool) -> None:
    path = tmp_path / "map.rrd"
    program = WRITES_UNTIL_KILLED.format(writer=writer, is_file=is_file, end=KILL)
    run = subprocess.run([sys.executable, "-c", program, str(path)], cwd=ROOT)
    assert run.returncode == -signal.SIGKILL
    assert len([*tmp_path.glob(".map.rrd.*")]) == 1
    other = tmp_path / ".other.rrd.01234567.part"
    other.mkdir()

    with atomic_output(path) as part:
        part.write_text("new")

    assert {each.name for each in tmp_path.iterdir()} == {path.name, other.name}


@needs_posix
@pytest.mark.parametrize(("writer", "is_file"), HOLDS)
def test_what_a_living_process_writes_is_never_removed(tmp_path: Path, writer: str, is_file: bool) -> None:
    path = tmp_path / "map.rrd"
    program = WRITES_UNTIL_KILLED.format(writer=writer, is_file=is_file, end=WAIT)
    command = [sys.executable, "-c", program, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as living:
        assert living.stdout is not None
        assert living.stdout.readline() == "begun\n"
        require_new_path(path)
        assert len([*tmp_path.glob(".map.rrd.*")]) == 1
        living.communicate("")
    assert living.returncode == 0
    assert [each.name for each in tmp_path.iterdir()] == ["map.rrd"]


@needs_posix
def test_a_forked_process_leaves_the_file_that_its_parent_is_writing(tmp_path: Path) -> None:
    try:
        with new_folder(tmp_path / "drive") as part:
            (part / "x").touch()
            child = os.fork()
            if child == 0:
                raise SystemExit  # Unwinds the block, as the end of a forked process may.
            os.waitpid(child, 0)
    except SystemExit:
        os._exit(0)
    assert (tmp_path / "drive" / "x").exists()
