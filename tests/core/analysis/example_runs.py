"""Small runs told by hand, for tests of the analysis."""

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, Node, NodeAdded, PoseRow
from ltvn_core.navigation import events as e
from ltvn_core.types import CONTROL_STEP_S


def at(step: int, *events: e.Event) -> list[e.StampedEvent]:
    """All events of one step."""
    return [e.StampedEvent(step, step * CONTROL_STEP_S, event) for event in events]


def node(frame: int, x_m: float = 0.0, cause: Cause = Cause.BUILD) -> e.GraphChanged:
    return e.GraphChanged(NodeAdded(Node(frame, PoseRow(x_m, 0.0, 0.0)), cause))


def edge(source: int, target: int, p: float = 0.9, mu: float = 1.0, cause: Cause = Cause.BUILD) -> e.GraphChanged:
    return e.GraphChanged(EdgeAdded(Edge(source, target, PoseRow(mu, 0.0, 0.0), Belief(p, mu, 0.02)), cause))


def localised(query: int, frame: int, place: int | None, distance: float = 0.2) -> e.Localised:
    return e.Localised(query, frame, place, distance, 0.9, None, 0.5, "global")


def attempt_started(query: int, attempt: int, source: int | None, target: int, frame: int) -> e.AttemptStarted:
    return e.AttemptStarted(query, attempt, source, target, frame, PoseRow(1.0, 0.0, 0.0), 0.9)


def arrived(begun: e.AttemptStarted, frame: int) -> e.AttemptEnded:
    ends = begun.query, begun.attempt, begun.source, begun.target
    return e.AttemptEnded(*ends, frame, e.AttemptEnd.REACHED, 0.1, 0.9, True, "target is near: d = 0.10, r = 0.90")


def failed(begun: e.AttemptStarted, frame: int, end: e.AttemptEnd = e.AttemptEnd.COLLISION) -> e.AttemptEnded:
    ends = begun.query, begun.attempt, begun.source, begun.target
    return e.AttemptEnded(*ends, frame, end, 0.9, 0.1, False, "target is still too far: d = 0.90, needs 0.70")


def belief(
    source: int, target: int, p: float, counts: tuple[int, int], source_attempt: tuple[int, int]
) -> e.GraphChanged:
    delta = BeliefUpdated(source, target, Belief(p, 1.0, 0.01), *counts, Cause.ATTEMPT)
    return e.GraphChanged(delta, *source_attempt)


def pruned(source: int, target: int, source_attempt: tuple[int, int]) -> e.GraphChanged:
    return e.GraphChanged(EdgePruned(source, target, Cause.ATTEMPT), *source_attempt)


def ended(query: int, goal: int, outcome: e.Outcome = e.Outcome.ARRIVED) -> e.QueryEnded:
    return e.QueryEnded(query, goal, outcome, 50, 0, 1.0)


def square() -> list[e.StampedEvent]:
    """A map 0 -> 1 -> 2 with a detour 0 -> 3 -> 2."""
    nodes = [node(frame, float(frame)) for frame in range(4)]
    edges = [edge(0, 1), edge(1, 2), edge(0, 3, mu=1.5), edge(3, 2, mu=1.5)]
    return at(10, *nodes, *edges)


def two_failures() -> list[e.StampedEvent]:
    """Two queries from 0 to 2; edge 1 -> 2 fails in both, is pruned, and the detour leads there."""
    first, second, third = (
        attempt_started(0, 1, 0, 1, 20),
        attempt_started(0, 2, 1, 2, 40),
        attempt_started(0, 3, 1, 2, 60),
    )
    fourth, detour = attempt_started(1, 4, 1, 2, 120), attempt_started(1, 5, 3, 2, 160)
    return [
        *square(),
        *at(20, e.QueryStarted(0, 2), localised(0, 20, 0), e.Planned(0, (0, 1, 2), 2.0), first),
        *at(40, arrived(first, 40), belief(0, 1, 0.95, (1, 1), (0, 1))),
        *at(40, localised(0, 40, 1), e.Planned(0, (1, 2), 1.0), second),
        *at(55, e.Collided(0, 1)),
        *at(60, failed(second, 60), belief(1, 2, 0.6, (1, 0), (0, 2))),
        *at(60, localised(0, 60, 1), e.Planned(0, (1, 2), 1.4), third),
        *at(80, failed(third, 80), ended(0, 2, e.Outcome.STEP_LIMIT), e.Judged(0, False, 1.0, 0.0)),
        *at(100, e.QueryStarted(1, 2), localised(1, 120, 1), e.Planned(1, (1, 2), 1.4), fourth),
        *at(140, failed(fourth, 140), belief(1, 2, 0.2, (2, 0), (1, 4)), pruned(1, 2, (1, 4))),
        *at(160, localised(1, 160, 3), e.Planned(1, (3, 2), 1.5), detour),
        *at(180, arrived(detour, 180), ended(1, 2), e.Judged(1, True, 0.1, 0.0)),
    ]


def timeline() -> Timeline:
    """The run of `two_failures`."""
    return Timeline.of(two_failures())
