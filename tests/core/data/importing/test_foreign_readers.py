"""A reader of another package that is broken is named, and does not keep a drive from the reader that can read it."""

from pathlib import Path

import pytest

from ltvn_core.plugins import READERS
from tests.core.data.importing.drives import EXCERPT
from tests.core.plugin_packages import install, ltvn

SOURCE = """
from tests.core.data.importing.drives import ListedDrive

class Raising:
    @classmethod
    def recognises(cls, path): raise ValueError("cannot look")
    @classmethod
    def open(cls, path, options): raise AssertionError

class Unopenable(Raising):
    @classmethod
    def recognises(cls, path): return True
    @classmethod
    def open(cls, path, options): return {}["no such key"]

class Factless(Unopenable):
    @classmethod
    def open(cls, path, options): return object()

class Halfway(Unopenable):
    @classmethod
    def open(cls, path, options):
        drive = ListedDrive([])
        drive.frames = lambda: iter([1])
        return drive
"""


def imported(folder: Path, reader: str, *options: str) -> tuple[int, str]:
    install(folder, "odd-readers", f"[{READERS.name}]\na-first = odd_readers:{reader}\n", source=SOURCE)
    run = ltvn(folder, "import", str(EXCERPT), "--output", str(folder / "drive.rrd"), *options)
    assert "Traceback" not in run.stderr
    return run.returncode, run.stderr


@pytest.mark.parametrize(
    ("reader", "said"),
    [("Raising", "cannot look"), ("Unopenable", "no such key"), ("Factless", "facts"), ("Missing", "Missing")],
)
def test_a_drive_is_imported_beside_a_broken_reader_which_is_named(tmp_path: Path, reader: str, said: str) -> None:
    code, told = imported(tmp_path, reader)

    assert (code, (tmp_path / "drive.rrd").exists()) == (0, True)
    named = [line for line in told.splitlines() if "reader a-first of the package odd-readers" in line]
    assert len(named) == 1
    assert said in named[0]


def test_a_reader_that_yields_no_frames_ends_its_import_with_its_name(tmp_path: Path) -> None:
    code, told = imported(tmp_path, "Halfway")

    assert code == 1
    assert "reader a-first of the package odd-readers" in told.splitlines()[-1]
    assert not (tmp_path / "drive.rrd").exists()
