"""The app as it runs for a browser that is drawn by software: a session in a thread of its own, and a patient lease."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ltvn_viz.app import AppOptions, RunningApp, open_app
from ltvn_viz.server.driver_seat import DriverSeat

_END_S = 60.0


@contextmanager
def running_app(options: AppOptions, *, lease_s: float = 5.0) -> Iterator[RunningApp]:
    """Open an app, run its session, and end both, also after an error."""
    # A page drawn by software may stall for longer than the lease of a real one.
    with open_app(options, seat=DriverSeat(lease_s=lease_s)) as app:
        thread = threading.Thread(target=app.session.run, name="session")
        thread.start()
        try:
            yield app
        finally:
            app.session.stop()
            thread.join(timeout=_END_S)
