"""A reader of another package that is broken is named, and does not keep a drive from the reader that can read it."""

from pathlib import Path

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


def imported(folder: Path, *readers: str) -> tuple[int, str]:
    entries = "".join(f"a-{reader.lower()} = odd_readers:{reader}\n" for reader in readers)
    install(folder, "odd-readers", f"[{READERS.name}]\n{entries}", source=SOURCE)
    run = ltvn(folder, "import", str(EXCERPT), "--output", str(folder / "drive.rrd"))
    assert "Traceback" not in run.stderr
    return run.returncode, run.stderr


def test_a_drive_is_imported_beside_broken_readers_which_are_named(tmp_path: Path) -> None:
    expected = {"Raising": "cannot look", "Unopenable": "no such key", "Factless": "facts", "Missing": "Missing"}
    code, told = imported(tmp_path, *expected)

    assert (code, (tmp_path / "drive.rrd").exists()) == (0, True)
    for reader, said in expected.items():
        (named,) = (line for line in told.splitlines() if f"reader a-{reader.lower()} of the package odd-" in line)
        assert said in named


def test_a_reader_that_yields_no_frames_ends_its_import_with_its_name(tmp_path: Path) -> None:
    code, told = imported(tmp_path, "Halfway")

    assert code == 1
    assert "reader a-halfway of the package odd-readers" in told.splitlines()[-1]
    assert not (tmp_path / "drive.rrd").exists()
