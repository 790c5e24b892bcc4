"""A verb that is asked to end: SIGTERM and SIGHUP finish the recording under way, as Ctrl-C does."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ltvn_core.data.recording.integrity import verify
from tests.platforms import needs_posix
from tests.repository import ROOT
from tests.waiting import PATIENCE_S, until

pytestmark = needs_posix

MORE_THAN_THE_BEGINNING = 400_000
"""Bytes; by then a tour has written images."""


def size_bytes(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


@pytest.mark.slow
@pytest.mark.parametrize("asked", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_tour_that_is_asked_to_end_leaves_a_finished_recording(tmp_path: Path, asked: signal.Signals) -> None:
    pytest.importorskip("embreex")
    path = tmp_path / "tour.rrd"
    # Whoever runs the tests in the background, or with nohup, hands on that interrupts or hang-ups are ignored.
    begin = "import signal as s, sys; s.signal(s.SIGINT, s.default_int_handler); s.signal(s.SIGHUP, s.SIG_DFL)"
    program = f"{begin}; from ltvn_core.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", program, "collect", "--output", str(path), "--loops", "50"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT) as tour:
        until(lambda: size_bytes(path) > MORE_THAN_THE_BEGINNING or tour.poll() is not None)
        tour.send_signal(asked)
        said, _ = tour.communicate(timeout=PATIENCE_S)
    assert tour.returncode == 128 + asked, said
    assert "Traceback" not in said
    assert verify(path).frames > 10
