"""A small drive with a map, for tests of recordings. Everything in it is drawn from a seed."""

from pathlib import Path

import numpy as np

from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.deltas import (
    Belief,
    BeliefUpdated,
    Cause,
    Edge,
    EdgeAdded,
    EdgePruned,
    FramesReserved,
    Node,
    NodeAdded,
    PoseRow,
)
from ltvn_core.navigation.events import (
    AttemptEnd,
    AttemptEnded,
    Event,
    GraphChanged,
    Localised,
    NavigatorState,
    Outcome,
    Planned,
    QueryEnded,
    QueryStarted,
    StampedEvent,
    StateChanged,
)
from ltvn_core.types import CONTROL_STEP_S, Observation


def observation(step: int, seed: int = 0) -> Observation:
    """Return a picture with smooth shapes, as JPEG likes them, and poses with all their digits."""
    rng = np.random.default_rng([seed, step])
    rows, columns = np.mgrid[:72, :96]
    shade = 120 + 80 * np.sin(columns / 17 + step) * np.cos(rows / 13)
    rgb = np.stack([shade, shade[::-1], 255 - shade], -1).astype(np.uint8)
    depth = (1 + columns / 30 + rng.random()).astype(np.float32)
    return Observation(rgb, depth, rng.normal(size=3), CONTROL_STEP_S * step, step, rng.normal(size=3))


def events() -> list[Event]:
    """Return a short life of a map of three nodes."""
    edges = [
        Edge(0, 4, PoseRow(0.5, 0.1, 0.01), Belief(0.9, 0.51, 0.017)),
        Edge(4, 0, PoseRow(-0.5, -0.1, -0.01), Belief(0.9, 0.51, 0.017)),
        Edge(4, 8, PoseRow(0.7, 0.0, 0.2), Belief(0.6, 0.8, 0.017)),
    ]
    nodes = [Node(frame, PoseRow(frame / 8, 1 / 3, 0.1)) for frame in (0, 4, 8)]
    return [
        *(GraphChanged(NodeAdded(node, Cause.BUILD)) for node in nodes),
        *(GraphChanged(EdgeAdded(edge, Cause.BUILD)) for edge in edges),
        GraphChanged(FramesReserved((1, 2, 3), Cause.BUILD)),
        QueryStarted(0, 8),
        StateChanged(NavigatorState.LOCALISING),
        Localised(0, 5, 4, 0.2, 0.93, None, float("inf"), "global"),
        Planned(0, (4, 8), 1.25),
        AttemptEnded(0, 0, 4, 8, 6, AttemptEnd.TIMEOUT, 1.1, 0.2, succeeded=False, reason="not connectable"),
        GraphChanged(BeliefUpdated(4, 8, Belief(1 / 3, 0.8, 0.017), 1, 0, Cause.ATTEMPT), 0, 0),
        GraphChanged(EdgePruned(4, 8, Cause.ATTEMPT), 0, 0),
        QueryEnded(0, 8, Outcome.NO_PATH, 60, 1, 1.5),
    ]


def write(path: Path, frames: int = 10) -> list[StampedEvent]:
    """Write a drive of some frames with the events spread over it, and return them."""
    stamped = [StampedEvent(k % frames, CONTROL_STEP_S * (k % frames), event) for k, event in enumerate(events())]
    with RecordingWriter(path, scene="demo", config={"seed": 7}, fingerprint="abc") as writer:
        for step in range(frames):
            writer.write_frame(observation(step))
        for event in stamped:
            writer.write_event(event)
    return stamped
