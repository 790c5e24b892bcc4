"""Events in one line each, for the log that a person reads. The exact event stands beside it; nothing parses this."""

from ltvn_core.graph import deltas as dl
from ltvn_core.navigation import events as ev

_QUIET_CAUSES = (*dl.BULK_CAUSES, dl.Cause.ONLINE)
"""A map that is built or loaded makes thousands of changes; the log tells their number, not each."""


def severity_of(event: ev.Event) -> ev.Severity:
    """Return how loud an event is in the log."""
    match event:
        case ev.Note(severity=severity):
            return severity
        case ev.Collided() | ev.Localised(node=None) | ev.Planned(nodes=()) | ev.AttemptEnded(succeeded=False):
            return ev.Severity.WARN
        case ev.Judged(reached=False):
            return ev.Severity.ERROR
        case ev.GraphChanged(delta=dl.EdgePruned() | dl.NodeDropped()):
            return ev.Severity.WARN
    return ev.Severity.INFO


def event_line(event: ev.Event) -> str | None:
    """Say an event in one line, or None when the log is better without it."""
    match event:
        case ev.Note(text=text):
            return text
        case ev.QueryStarted(query=query, goal=goal):
            return f"query {query}: go to {goal}"
        case ev.QueryEnded(query=query, outcome=outcome, steps=steps, collisions=collisions, path_m=path_m):
            return f"query {query}: {outcome} after {steps} steps, {path_m:.1f} m, {collisions} collisions"
        case ev.Judged(query=query, reached=reached, position_error_m=position_m, yaw_error_rad=yaw_rad):
            verdict = "reached" if reached else "missed"
            return f"query {query}: goal {verdict}, {position_m:.2f} m and {yaw_rad:.2f} rad away"
        case ev.Collided(count=count):
            return f"collision {count}"
        case ev.GraphChanged(delta=delta) if delta.cause not in _QUIET_CAUSES:
            return _delta_line(delta)
    return _navigation_line(event)


def _navigation_line(event: ev.Event) -> str | None:
    match event:
        case ev.Localised(node=None, distance=distance, scope=scope):
            return f"lost: the best node is {distance:.2f} away ({scope})"
        case ev.Localised(node=node, distance=distance, margin=margin, scope=scope):
            return f"at {node}, distance {distance:.2f}, margin {margin:.2f} ({scope})"
        case ev.Planned(nodes=()):
            return "no path"
        case ev.Planned(nodes=nodes, cost=cost):
            return f"plan {' → '.join(map(str, nodes))}, cost {cost:.2f}"
        case ev.AttemptStarted(attempt=attempt, source=source, target=target, reachability=reachability):
            return f"leg {attempt}: {_edge(source, target)}, reachability {reachability:.2f}"
        case ev.AttemptEnded(
            attempt=attempt, source=source, target=target, end=end, succeeded=succeeded, reason=reason
        ):
            verdict = "succeeded" if succeeded else "failed"
            return f"leg {attempt}: {_edge(source, target)} {verdict} ({end}): {reason}"
    return None


def _delta_line(delta: dl.GraphDelta) -> str:
    match delta:
        case dl.NodeAdded(node=node, cause=cause):
            return f"node {node.id} added ({cause})"
        case dl.NodeDropped(node=node, cause=cause):
            return f"node {node} dropped ({cause})"
        case dl.EdgeAdded(edge=edge, cause=cause):
            return f"edge {_edge(edge.source, edge.target)} added, p {edge.belief.p:.2f} ({cause})"
        case dl.BeliefUpdated(source=source, target=target, belief=belief, attempts=attempts, successes=successes):
            return f"edge {_edge(source, target)}: p {belief.p:.2f}, {successes} of {attempts} attempts"
        case dl.EdgePruned(source=source, target=target, cause=cause):
            return f"edge {_edge(source, target)} pruned ({cause})"
        case dl.EdgeProtected(source=source, target=target, protected=protected):
            return f"edge {_edge(source, target)} {'protected' if protected else 'no longer protected'}"
        case dl.NodeNamed(node=node, name=name, goal=goal):
            return f"node {node} {f'named {name!r}' if name else 'has no name now'}{', a goal' if goal else ''}"
        case dl.FramesReserved(frames=frames):
            return f"{len(frames)} images joined the reserve"
        case dl.FramesReleased(frames=frames):
            return f"{len(frames)} images left the reserve"


def _edge(source: int | None, target: int) -> str:
    return f"{'here' if source is None else source} → {target}"
