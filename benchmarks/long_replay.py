"""What it costs to open a long run on a large map, and to go anywhere in it; part of `python -m benchmarks`.

Owns the measuring. The page's side of it, sending and drawing, is `benchmarks.drive_latency`'s.
"""

import numpy as np

from benchmarks.measurement import Measurement, alternating, measured, seconds, seconds_once
from benchmarks.replay_opening import open_from_disk
from benchmarks.synthetic_run import EVENTS, synthetic_run
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import RecordingError
from ltvn_core.navigation.events import StampedEvent
from ltvn_core.types import FrameId, Observation
from ltvn_viz.session.activities.playback import Playback

SEEKS = 51


def _no_observation(frame: FrameId) -> Observation:
    """Stand in for the images, which cost the same wherever one goes."""
    raise RecordingError(f"Frame {frame} was never taken.")


def open_and_travel() -> list[Measurement]:
    """Open a run of 50,000 events on a map of 10,000 nodes and 50,000 edges, and look at it at random moments."""
    events, rng = synthetic_run(), np.random.default_rng(0)
    replay = _opened(events)

    def seek() -> None:
        replay.seek(float(rng.uniform(0.0, replay.length_s)))
        replay.moment()

    def fold() -> None:
        replay.timeline.graph_at(replay.timeline.instant(int(rng.integers(len(events) - EVENTS, len(events)))))

    open_s = seconds_once(lambda: _opened(events).timeline.queries)
    lived = events[len(events) - EVENTS :]
    longer = alternating(lambda: Timeline.of(lived[: EVENTS // 2]).queries, lambda: Timeline.of(lived).queries, 9)
    return [
        measured(f"index {EVENTS:,} events and fold them for the page", open_s, "s", at_most=3),
        measured("indexing twice as many events", longer, "x", at_most=2.5),
        measured("seek anywhere in them", 1e3 * seconds(seek, SEEKS), "ms", at_most=100),
        measured("the map at any moment of them", 1e3 * seconds(fold, SEEKS), "ms", at_most=100),
        *open_from_disk(),
    ]


def _opened(events: list[StampedEvent]) -> Playback:
    driven = events[len(events) - EVENTS :]
    frames = [(stamped.step, stamped.stamp, np.zeros(3)) for stamped in driven]
    return Playback("long", "nowhere", Timeline.of(events, frames), _no_observation, config={})
