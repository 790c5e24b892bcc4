"""Damages drives of other programs as disks, transfers and strangers do, and judges what `ltvn import` makes of it.

Each attempt runs in a process of its own batch, so that one that aborts or hangs is seen and the others go on.
"""

import faulthandler
import hashlib
import json
import logging
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.data.importing.drive_import import import_drive
from ltvn_core.data.importing.import_options import ImportOptions
from ltvn_core.data.importing.reader_registry import open_drive
from ltvn_core.errors import LtvnError
from tests.repository import ROOT

HANG_S = 10
"""An import of a small drive that takes more processor time than this is a hang."""
_STUCK_S = 120
"""So is one that waits for longer than this, which a busy machine does not explain."""
_NUMBERS = (b"-1", b"0", b"1e308", b"nan", b"99999999999999999999", b"..", b"/", b"\xff\xfe", b"{", b"")


class Fate(StrEnum):
    """What became of a damaged drive."""

    IMPORTED = "imported"
    REFUSED = "refused"
    """With a message for people."""
    TRACEBACK = "traceback"
    """An error that is not told to people came out."""
    ABORTED = "aborted"
    """It ended the process, as a segmentation fault does."""
    HUNG = "hung"
    TOUCHED = "touched"
    """Something other than the output was changed or written."""


@dataclass(frozen=True)
class Judgement:
    """What `ltvn import` made of a damaged drive."""

    number: int
    kind: str
    """Which file was damaged, and how."""
    fate: Fate
    detail: str = ""


def judge_mutations(sources: Path, scratch: Path, *, seed: int, first: int, count: int) -> Iterator[Judgement]:
    """Yield a judgement of each mutation `first` to `first + count - 1` of the drives in a folder.

    Args:
        sources: Each file or folder in it is one drive; they are copied, never changed.
        scratch: An empty folder to work in.
        seed: Draws the drive, the file and the damage, together with the mutation's number.
        first: Number of the first mutation.
        count: How many to judge.
    """
    number = first
    while number < first + count:
        command = [
            sys.executable,
            "-m",
            __name__,
            str(sources),
            str(scratch),
            str(seed),
            str(number),
            str(first + count),
        ]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        started = number
        for line in lines:
            entry = json.loads(line)
            if "fate" in entry:
                yield Judgement(**entry | {"fate": Fate(entry["fate"])})
                number = entry["number"] + 1
            else:
                started = entry["number"]
        if number < first + count:  # The process ended before its last mutation was judged.
            kind = next((json.loads(line)["kind"] for line in reversed(lines) if f'"number": {started}' in line), "")
            is_hung = "Timeout (" in done.stderr or done.returncode == -signal.SIGPROF
            fate = Fate.HUNG if is_hung else Fate.ABORTED
            yield Judgement(number, kind, fate, done.stderr[-2000:])
            number += 1


def mutate(drive: Path, rng: np.random.Generator) -> str:
    """Damage one file of a drive in place; return what was done."""
    files = sorted(path for path in [drive, *drive.rglob("*")] if path.is_file())
    # Lists, tables and headers are few beside images, and all depends on them.
    suffixes = sorted({path.suffix for path in files})
    suffix = suffixes[int(rng.integers(len(suffixes)))]
    path = [path for path in files if path.suffix == suffix][int(rng.integers(sum(p.suffix == suffix for p in files)))]
    data = bytearray(path.read_bytes())
    size, at = len(data), int(rng.integers(max(len(data), 1)))
    kinds = ("flip", "flips", "cut", "zeros", "repeat", "number", "empty", "missing", "folder", "noise", "header")
    kind = kinds[int(rng.integers(len(kinds)))]
    match kind:
        case "flip" if size:
            data[at] ^= 1 << int(rng.integers(8))
        case "flips" if size:
            for k in rng.integers(size, size=20).tolist():
                data[k] ^= 1 << int(rng.integers(8))
        case "header" if size:
            for k in rng.integers(min(size, 256), size=3).tolist():
                data[k] = int(rng.integers(256))
        case "cut":
            del data[at:]
        case "zeros":
            data[at : at + 512] = bytes(min(512, size - at))
        case "repeat":
            data[at:at] = data[at // 2 : at]
        case "number":
            digits = [k for k, byte in enumerate(data[:20000]) if chr(byte).isdigit()] or [at]
            place = digits[int(rng.integers(len(digits)))]
            data[place : place + 1] = _NUMBERS[int(rng.integers(len(_NUMBERS)))]
        case "noise":
            data = bytearray(rng.bytes(min(size, 100_000)))
        case "empty":
            data.clear()
        case _:
            pass
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind != "missing":
        path.write_bytes(data)
    return f"{path.relative_to(drive.parent)}: {kind} at {at} of {size}"


def _judged(drive: Path, output: Path, number: int, kind: str) -> Judgement:
    before = _fingerprint(drive.parent)
    try:
        import_drive(open_drive(drive), output, ImportOptions())
        fate, detail = Fate.IMPORTED, ""
    except LtvnError as error:
        fate, detail = Fate.REFUSED, str(error)
    except BaseException:
        fate, detail = Fate.TRACEBACK, traceback.format_exc()[-3000:]
    if _fingerprint(drive.parent) != before:
        return Judgement(number, kind, Fate.TOUCHED, "the drive itself changed")
    if others := [path.name for path in output.parent.iterdir() if path not in (output, drive.parent)]:
        return Judgement(number, kind, Fate.TOUCHED, f"left beside the output: {others}")
    return Judgement(number, kind, fate, detail)


def _fingerprint(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        digest.update(str(path).encode())
        digest.update(path.read_bytes() if path.is_file() else b"")
    return digest.hexdigest()


def _main(arguments: Sequence[str]) -> None:
    sources, scratch = Path(arguments[0]), Path(arguments[1])
    seed, first, end = (int(argument) for argument in arguments[2:])
    logging.disable(logging.CRITICAL)
    drives = sorted(sources.iterdir())
    for number in range(first, end):
        rng = np.random.default_rng([seed, number])
        shutil.rmtree(scratch, ignore_errors=True)
        source = drives[int(rng.integers(len(drives)))]
        copy = scratch / "source" / source.name
        copy.parent.mkdir(parents=True)
        if source.is_dir():
            shutil.copytree(source, copy)
        else:
            shutil.copyfile(source, copy)
        kind = mutate(copy, rng)
        if copy.exists():
            _tell({"number": number, "kind": kind})
            faulthandler.dump_traceback_later(_STUCK_S, exit=True)
            signal.setitimer(signal.ITIMER_PROF, HANG_S)  # Ends the process by SIGPROF.
            judgement = _judged(copy, scratch / "drive.rrd", number, kind)
            signal.setitimer(signal.ITIMER_PROF, 0)
            faulthandler.cancel_dump_traceback_later()
        else:
            judgement = Judgement(number, kind, Fate.REFUSED, "nothing is left")
        _tell(asdict(judgement))


def _tell(entry: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(entry) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    _main(sys.argv[1:])
