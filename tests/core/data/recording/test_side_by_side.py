"""Recordings that several threads begin and end at the same time."""

import subprocess
import sys
from pathlib import Path

import pytest

from ltvn_core.data.recording.integrity import verify
from tests.repository import ROOT
from tests.waiting import PATIENCE_S

THREADS, EACH = 4, 10
PROGRAM = f"""
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
sys.path.insert(0, {str(ROOT)!r})
from tests.core.data.recording.example_recording import write

def record(thread):
    for number in range({EACH}):
        write(Path(f"{{thread}}-{{number}}.rrd"), frames=8)

with ThreadPoolExecutor({THREADS}) as pool:
    list(pool.map(record, range({THREADS})))
"""


@pytest.mark.slow
def test_threads_that_begin_and_end_recordings_do_not_wait_for_each_other(tmp_path: Path) -> None:
    """Run in a process of its own, because one that hangs holds Python's GIL."""
    run = [sys.executable, "-c", PROGRAM]
    subprocess.run(run, cwd=tmp_path, check=True, timeout=PATIENCE_S)

    files = [*tmp_path.glob("*.rrd")]
    assert len(files) == THREADS * EACH
    assert {verify(file).frames for file in files} == {8}
