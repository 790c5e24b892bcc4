"""Processes that are forked while a recording is open, as multiprocessing does on Linux."""

import subprocess
import sys
from pathlib import Path

from ltvn_core.data.recording.integrity import verify
from tests.platforms import needs_posix
from tests.repository import ROOT

pytestmark = needs_posix

PROGRAM = """
import multiprocessing, sys
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import RecordingError
from tests.core.data.recording import example_recording

def record(path, first):
    with RecordingWriter(path, scene="demo", config={}, fingerprint="") as writer:
        writer.write_frame(example_recording.observation(first))

def child():
    record("child.rrd", 0)
    try:
        parents.write_frame(example_recording.observation(7))
    except RecordingError as error:
        assert "file of your own" in str(error)
    else:
        raise AssertionError("it took a frame for the file of another process")
    parents.close()
    sys.exit(3)

with RecordingWriter("parent.rrd", scene="demo", config={}, fingerprint="") as parents:
    parents.write_frame(example_recording.observation(0))
    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    process.join()
    parents.write_frame(example_recording.observation(1))
sys.exit(process.exitcode)
"""


def test_a_forked_process_records_its_own_file_and_leaves_that_of_its_parent_alone(tmp_path: Path) -> None:
    program = f"import os, sys; sys.path.insert(0, {str(ROOT)!r})\n{PROGRAM}"
    run = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert run.returncode == 3, run.stderr
    assert (verify(tmp_path / "parent.rrd").frames, verify(tmp_path / "child.rrd").frames) == (2, 1)
