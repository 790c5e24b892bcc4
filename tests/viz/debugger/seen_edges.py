"""A live map that learns which of its edges are open, as tests of the questions about it need one."""

from pathlib import Path

from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.navigation.events import GraphChanged, WorldChanged
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.worlds import TimePassed
from tests.viz.session_harness import SessionHarness

HOUR = 3600.0


def open_harness(folder: Path) -> SessionHarness:
    """Return a session with a live map whose plans look at presence; it is 8 o'clock."""
    harness = SessionHarness(folder)
    live_map = harness.state.live_map
    live_map.use_system(with_maintenance(live_map.system, "persistent"))
    pass_time(harness, 8 * HOUR)
    return harness


def pass_time(harness: SessionHarness, until_s: float) -> None:
    """Let the clock of the world jump."""
    harness.state.live.emit(WorldChanged(TimePassed(0.0), at_s=until_s))


def see(harness: SessionHarness, edge: tuple[int, int], at_s: float, *, present: bool) -> None:
    """Let the live map learn that an edge is open or blocked."""
    pass_time(harness, at_s)
    seen = PresenceObserved(*edge, present=present, stamp=at_s, cause=Cause.SIGHT)
    for delta in harness.state.live_map.change([seen]):
        harness.state.live.emit(GraphChanged(delta, query=0))
