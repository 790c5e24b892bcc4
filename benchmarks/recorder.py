"""How long a person waits for a recording to begin, and to hear that it failed; part of `python -m benchmarks`."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.measurement import Measurement, measured
from benchmarks.soak import running_app
from ltvn_viz.app import RunningApp
from ltvn_viz.wishes import commands as c

REPEATS = 20
PATIENCE_S = 60.0


def begin_and_fail() -> list[Measurement]:
    """Begin many recordings while the app navigates, and take every second file away."""
    with tempfile.TemporaryDirectory() as folder, running_app(Path(folder)) as app:
        app.session.send(c.Ask(c.Action.GOAL, next(iter(app.session.state.live_map.graph.nodes))))
        began, noticed = list[float](), list[float]()
        for number in range(REPEATS):
            files = set(Path(folder).glob("*.rrd"))
            app.session.send(c.Ask(c.Action.RECORD))
            began.append(_seconds_until(lambda: set(Path(folder).glob("*.rrd")) - files))  # noqa: B023
            _seconds_until(lambda: _name(app) is not None)
            if number % 2:
                (Path(folder) / str(_name(app))).unlink()
                noticed.append(_seconds_until(lambda: not app.session.state.live.recorder.is_on))
            else:
                app.session.send(c.Ask(c.Action.KEEP))
                _seconds_until(lambda: not app.session.state.live.recorder.is_on)
    return [
        measured("from R to the file, 95th percentile", 1e3 * float(np.percentile(began, 95)), "ms", at_most=300),
        measured("from a deleted file to the message, longest", max(noticed), "s", at_most=2),
    ]


def _name(app: RunningApp) -> str | None:
    return app.session.state.live.recorder.status.name


def _seconds_until(holds: Callable[[], object]) -> float:
    began = time.monotonic()
    while not holds():
        assert time.monotonic() - began < PATIENCE_S, "it never happened"
        time.sleep(0.002)
    return time.monotonic() - began
