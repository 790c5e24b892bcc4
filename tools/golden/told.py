"""A run told by hand, with what the shipped recordings lack: blocked edges, new nodes, a person's changes, two maps.

Its images are those of a shipped drive, so that questions which compare images can be answered.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.types import CONTROL_STEP_S, FrameId, NodeId
from ltvn_core.worlds import DoorMoved, TimePassed

IMAGES = (28, 41, 149, 160, 174, 187, 55, 9)
"""Frames of the drive that are the images 0 to 7 of the run; 6 is in the reserve, 7 a place that was new."""
ROADS: tuple[tuple[NodeId, NodeId, float, float], ...] = (
    (0, 1, 0.9, 0.6),
    (1, 0, 0.9, 0.6),
    (1, 2, 0.9, 0.5),
    (2, 3, 0.8, 0.5),
    (3, 4, 0.95, 0.6),
    (4, 5, 0.7, 0.6),
    (0, 3, 0.6, 1.4),
    (5, 4, 0.9, 0.6),
)
"""Source, target, p and length (mu) of the edges of the map at the start."""
PLANNED, PRUNED, NEVER, BLIND, OPEN_AGAIN, BLOCKED, BY_HAND, LOST, EXPANDED, RESERVED = EDGES = (
    (0, 1),
    (1, 2),
    (2, 1),
    (0, 3),
    (3, 4),
    (4, 5),
    (5, 0),
    (7, 3),
    (2, 6),
    (1, 6),
)
"""What became of edges and pairs of nodes of the run, which are asked about."""
STEPS = (10, 45, 62, 90, 142, 165, 205, 255, 305, 330, 355, 400)
"""Asked about: a new map, a query while it fails, between queries, after each change, and after another map came."""
TEXT_STEPS = (45, 165, 255, 355)
"""Where texts are typed too, and where questions are asked that take long."""
HOUR_S = 3600.0
_Stamped = Iterator[e.StampedEvent]


def write(path: Path, drive: Recording) -> None:
    """Write the run with images of a drive."""
    config = {"maintenance": "persistent", "system": "ltvn"}
    with RecordingWriter(path, scene="demo", config=config, fingerprint=drive.meta.fingerprint) as writer:
        for step, frame in enumerate(IMAGES):
            writer.write_frame(replace(drive.observation(frame), step=step, stamp=step * CONTROL_STEP_S))
        for step in range(20, 420, 20):
            seen = drive.observation(IMAGES[step // 20 % len(IMAGES)])
            writer.write_frame(replace(seen, step=step, stamp=step * CONTROL_STEP_S))
        poses = [d.PoseRow(*map(float, drive.observation(frame).odometry)) for frame in IMAGES]
        for stamped in (*_map(poses), *_failed(), *_arrived(poses), *_changed(poses)):
            writer.write_event(stamped)


def _at(step: FrameId, *events: e.Event) -> _Stamped:
    for event in events:
        yield e.StampedEvent(step, step * CONTROL_STEP_S, event)


def _edge(source: NodeId, target: NodeId, p: float, mu: float, cause: d.Cause, *, blind: bool = False) -> e.Event:
    edge = d.Edge(source, target, d.PoseRow(mu, 0.1, 0.2), d.Belief(p, mu, 0.02), by_odometry=blind)
    return e.GraphChanged(d.EdgeAdded(edge, cause))


def _learned(edge: EdgeKey, p: float, counts: tuple[int, int], query: int, attempt: int) -> e.Event:
    return e.GraphChanged(d.BeliefUpdated(*edge, d.Belief(p, 0.7, 0.01), *counts, d.Cause.ATTEMPT), query, attempt)


def _seen(edge: EdgeKey, stamp_s: float, cause: d.Cause, *, present: bool, query: int, attempt: int) -> e.Event:
    return e.GraphChanged(d.PresenceObserved(*edge, present=present, stamp=stamp_s, cause=cause), query, attempt)


def _look(query: int, frame: FrameId, place: NodeId | None, probability: float | None = None) -> e.Event:
    return e.Localised(query, frame, place, 0.3, 0.8, 4, 0.4, "global", probability)


def _leg(
    query: int,
    number: int,
    edge: tuple[NodeId | None, NodeId],
    steps: tuple[int, int],
    end: e.AttemptEnd,
    rule: str = "",
) -> tuple[e.Event, e.Event]:
    """Return the begin and the end of an attempt; it succeeds if it ends where no rule objects."""
    succeeded = end is e.AttemptEnd.REACHED and not rule
    reason = "target is near: d = 0.20, r = 0.90" if succeeded else "target is still too far: d = 0.90, needs 0.70"
    begun = e.AttemptStarted(query, number, *edge, steps[0], d.PoseRow(0.6, 0.0, 0.1), 0.9)
    return begun, e.AttemptEnded(query, number, *edge, steps[1], end, 0.9, 0.2, succeeded, reason, rule)


def _map(poses: list[d.PoseRow]) -> _Stamped:
    """Tell of a map of six nodes at 8 o'clock, with an image left over."""
    yield from _at(8, *(e.GraphChanged(d.NodeAdded(d.Node(k, poses[k]), d.Cause.BUILD)) for k in range(6)))
    yield from _at(8, *(_edge(*road, d.Cause.BUILD, blind=road[:2] == (0, 3)) for road in ROADS))
    yield from _at(8, e.GraphChanged(d.FramesReserved((6,), d.Cause.BUILD)))
    yield from _at(8, e.WorldChanged(TimePassed(0.0), at_s=8 * HOUR_S))


def _failed() -> _Stamped:
    """Tell of two queries in which edge 1 -> 2 fails until it is pruned; the first one ends nowhere."""
    first, second = (
        _leg(0, 1, (0, 1), (20, 40), e.AttemptEnd.REACHED),
        _leg(0, 2, (1, 2), (40, 60), e.AttemptEnd.COLLISION),
    )
    third = _leg(0, 3, (1, 2), (60, 80), e.AttemptEnd.TIMEOUT, "judging.success_distance")
    fourth = _leg(1, 4, (1, 2), (120, 140), e.AttemptEnd.BLOCKED)
    yield from _at(20, e.QueryStarted(0, 5), e.StateChanged(e.NavigatorState.LOCALISING), _look(0, 20, 0, 0.9))
    yield from _at(20, e.Planned(0, (0, 1, 2, 3, 4, 5), 3.3, 0.9), first[0])
    yield from _at(40, first[1], _learned((0, 1), 0.93, (1, 1), 0, 1), _look(0, 40, 1, 0.4))
    yield from _at(40, e.Planned(0, (1, 2, 3, 4, 5), 2.7, 0.4), second[0])
    yield from _at(55, e.Collided(0, 1))
    yield from _at(
        60, second[1], _learned((1, 2), 0.6, (1, 0), 0, 2), _look(0, 60, 1), e.Planned(0, (1, 2), 1.4), third[0]
    )
    yield from _at(80, third[1], e.QueryEnded(0, 5, e.Outcome.STEP_LIMIT, 60, 1, 1.5, "recovering.step_limit"))
    yield from _at(80, e.Judged(0, False, 1.2, 0.3))
    yield from _at(
        100, e.QueryStarted(1, 3), _look(1, 100, None), _look(1, 120, 1), e.Planned(1, (1, 2, 3), 2.0), fourth[0]
    )
    yield from _at(140, fourth[1], _learned((1, 2), 0.2, (2, 0), 1, 4))
    yield from _at(140, e.GraphChanged(d.EdgePruned(1, 2, d.Cause.ATTEMPT), 1, 4))
    yield from _at(145, e.QueryEnded(1, 3, e.Outcome.NO_PATH, 45, 0, 0.4), e.Judged(1, False, 0.9, 0.1))


def _arrived(poses: list[d.PoseRow]) -> _Stamped:
    """Tell of a query with a new node, an edge seen blocked, and one in which it is tried later in the day."""
    fifth, sixth = (
        _leg(2, 5, (3, 4), (160, 170), e.AttemptEnd.BLOCKED),
        _leg(2, 6, (0, 3), (180, 200), e.AttemptEnd.REACHED),
    )
    yield from _at(150, e.QueryStarted(2, 5), _look(2, 150, None), _look(2, 152, None))
    yield from _at(152, e.GraphChanged(d.NodeAdded(d.Node(7, poses[7]), d.Cause.NOVEL), 2))
    yield from _at(152, _edge(7, 3, 0.9, 0.5, d.Cause.NOVEL), _edge(3, 7, 0.9, 0.5, d.Cause.NOVEL))
    yield from _at(160, _look(2, 160, 7, 0.8), e.GraphChanged(d.NodeAdded(d.Node(6, poses[6]), d.Cause.EXPAND), 2))
    yield from _at(160, _edge(2, 6, 0.8, 0.6, d.Cause.EXPAND), _edge(6, 3, 0.8, 0.6, d.Cause.EXPAND))
    yield from _at(160, e.Planned(2, (7, 3, 4, 5), 1.7, 0.8), fifth[0])
    at_s = 8 * HOUR_S + 16
    yield from _at(170, fifth[1], _seen((3, 4), at_s, d.Cause.ATTEMPT, present=False, query=2, attempt=5))
    yield from _at(170, _learned((3, 4), 0.9, (1, 0), 2, 5))
    yield from _at(180, _look(2, 180, 0, 0.7), e.Planned(2, (0, 3), 1.9, 0.7), sixth[0])
    yield from _at(200, sixth[1], _learned((0, 3), 0.85, (1, 1), 2, 6))
    yield from _at(200, _seen((4, 5), at_s + 3, d.Cause.SIGHT, present=False, query=2, attempt=6))
    yield from _at(210, e.QueryEnded(2, 5, e.Outcome.ARRIVED, 60, 0, 2.0), e.Judged(2, True, 0.1, 0.05))
    yield from _at(240, e.WorldChanged(TimePassed(HOUR_S), at_s=9 * HOUR_S + 24))
    seventh = _leg(3, 7, (3, 4), (250, 270), e.AttemptEnd.REACHED)
    yield from _at(250, e.QueryStarted(3, 5), _look(3, 250, 3), e.Planned(3, (3, 4, 5), 1.4), seventh[0])
    yield from _at(270, seventh[1], _seen((3, 4), 9 * HOUR_S + 27, d.Cause.ATTEMPT, present=True, query=3, attempt=7))
    yield from _at(280, e.QueryEnded(3, 5, e.Outcome.ARRIVED, 30, 0, 1.0), e.Judged(3, False, 2.1, 0.2))


def _changed(poses: list[d.PoseRow]) -> _Stamped:
    """Tell of a person who changes the map, of a door that closes, and of another map."""
    by_hand = d.Edge(5, 0, d.PoseRow(2.0, 0.0, 0.0), d.Belief(0.95, 2.0, 0.01), protected=True, action="Take the lift")
    yield from _at(
        300,
        e.GraphChanged(d.EdgeAdded(by_hand, d.Cause.HAND)),
        e.GraphChanged(d.NodeNamed(5, "kitchen", True, d.Cause.HAND)),
    )
    yield from _at(310, e.GraphChanged(d.EdgeProtected(4, 5, True, d.Cause.HAND)))
    yield from _at(320, e.GraphChanged(d.NodeDropped(7, d.Cause.HAND)))
    yield from _at(340, e.WorldChanged(DoorMoved(2, is_open=False), at_s=9 * HOUR_S + 34))
    yield from _at(350, _seen((3, 4), 9 * HOUR_S + 35, d.Cause.SIGHT, present=False, query=3, attempt=7))
    yield from _at(
        360,
        e.QueryStarted(4, 5),
        _look(4, 360, None),
        e.Note("The goal looked near, but is elsewhere.", rule="judging.odometry_gap"),
    )
    yield from _at(
        390,
        e.GraphChanged(d.NodeAdded(d.Node(0, poses[0]), d.Cause.LOAD)),
        e.GraphChanged(d.NodeAdded(d.Node(1, poses[1]), d.Cause.LOAD)),
    )
    yield from _at(390, _edge(0, 1, 0.8, 0.6, d.Cause.LOAD))
