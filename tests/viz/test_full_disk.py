"""The app in a process of its own on a disk that fills up: it says so, goes on, and ends when it is asked to."""

import subprocess
import sys
from pathlib import Path

import pytest

from ltvn_core.data.recording.integrity import repair
from tests.repository import ROOT
from tests.waiting import PATIENCE_S

# The demo map alone fills more than this; a batch, which comes into the file whole or not at all, fills less.
LIMIT_BYTES = 1_500_000

APP = """
import os, resource, signal, sys, threading
from pathlib import Path
from ltvn_viz.app import AppOptions, open_app
from ltvn_viz.server.guarded_server import stop_on_signals
from ltvn_viz.wishes.commands import Action, Ask
from tests.waiting import until

def watch(app):
    until(lambda: app.session.state.message is not None and "Recording stopped" in app.session.state.message.text)
    print(app.session.state.message.text, flush=True)
    before = app.session.state.live.robot.state().stamp
    until(lambda: app.session.state.live.robot.state().stamp > before + 0.5)
    print("time goes on", flush=True)
    os.kill(os.getpid(), signal.SIGTERM)

with open_app(AppOptions(port=0, recordings=Path(sys.argv[1]))) as app, stop_on_signals(app.session.stop):
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, 2 * (int(sys.argv[2]),))
    app.session.send(Ask(Action.RECORD))
    threading.Thread(target=watch, args=[app]).start()
    app.session.run()
print("ended", flush=True)
"""


@pytest.mark.slow
def test_an_app_whose_disk_is_full_says_so_goes_on_and_ends_at_sigterm(tmp_path: Path) -> None:
    pytest.importorskip("embreex")
    run = subprocess.run(
        [sys.executable, "-c", APP, str(tmp_path / "drives"), str(LIMIT_BYTES)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=2 * PATIENCE_S,
    )
    assert run.returncode == 0, run.stderr
    assert "File too large" in run.stdout
    assert run.stdout.endswith("time goes on\nended\n")
    (drive,) = (tmp_path / "drives").glob("*.rrd")
    assert repair(drive, tmp_path / "repaired.rrd").frames > 0
    assert (tmp_path / "drives").stat().st_mode & 0o777 == 0o700
