"""Describes an event or a change of the map in one line, and names its edge or node.

The only place where events are put into words: the Rerun log, marks on the slider and the debugger show these lines.
The exact event is stored beside each line, so nothing parses the text. A new kind of event or change needs a `case`
here; pyright reports this file until it has one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId
from ltvn_core.worlds import change_text

_MAX_NODES = 8
"""Number of nodes above which a path is described by its first and last nodes."""
_ARRIVED_BY = {e.BY_IMAGE: " by its image", e.BY_PLACE: " by the images around", e.BY_WAYPOINT: " by its waypoint"}
"""Rule of an arrival -> what showed it."""


@dataclass(frozen=True, slots=True)
class EventDescription:
    """An event in words."""

    text: str
    """One line without a full stop; it begins with a lower-case letter unless a person wrote it."""
    severity: e.Severity = e.Severity.INFO
    edge: EdgeKey | None = None
    """The edge that was driven or changed; for an attempt its first node and its subgoal."""
    node: NodeId | None = None
    """The node that the robot is at or drives to, or that changed."""

    @property
    def sentence(self) -> str:
        """The line as a sentence."""
        return self.text[:1].upper() + self.text[1:] + ("" if self.text.endswith((".", "!", "?")) else ".")


def describe_event(event: e.Event) -> EventDescription:
    """Describe an event in words."""
    match event:
        case e.StateChanged(state):
            return EventDescription(f"now {state}")
        case e.QueryStarted(query, goal):
            return EventDescription(f"query {query} started: node {goal} is the goal", node=goal)
        case e.Localised():
            return _localised(event)
        case e.Planned():
            return _planned(event)
        case e.AttemptStarted():
            text = f"{_attempt(event)} started, reachability {event.reachability:.2f}"
            return EventDescription(text, edge=_driven_edge(event), node=event.target)
        case e.AttemptEnded():
            verdict = f"succeeded ({event.end})" if event.succeeded else event.end.failure
            severity = e.Severity.INFO if event.succeeded else e.Severity.WARN
            text = f"{_attempt(event)} {verdict}" + (f": {event.reason}" if event.reason else "")
            return EventDescription(text, severity, edge=_driven_edge(event))
        case e.ActionBegun(_, source, target, _, action):
            ends = (source, target)
            return EventDescription(f"action of {edge_text(ends)} begun: {action}", edge=ends, node=target)
        case e.ActionEnded(_, source, target, _, succeeded, reason):
            ends = (source, target)
            verdict, severity = ("done", e.Severity.INFO) if succeeded else ("failed", e.Severity.WARN)
            text = f"action of {edge_text(ends)} {verdict}" + (f": {reason}" if reason else "")
            return EventDescription(text, severity, edge=ends)
        case e.Collided(query, count):
            return EventDescription(f"collision {count} of query {query}", e.Severity.WARN)
        case e.GraphChanged(delta):
            return describe_delta(delta)
        case e.QueryEnded(query, _, outcome, steps, collisions, path_m):
            driven = f"{count_text(steps, 'step')}, {path_m:.1f} m, {count_text(collisions, 'collision')}"
            why = _ARRIVED_BY.get(event.rule, "")
            return EventDescription(f"query {query} ended: {outcome}{why} after {driven}")
        case e.Judged(query, reached, position_m, yaw_rad):
            verdict, severity = ("reached", e.Severity.INFO) if reached else ("missed", e.Severity.ERROR)
            text = f"query {query} judged: goal {verdict}, {position_m:.2f} m and {yaw_rad:.2f} rad away"
            return EventDescription(text, severity)
        case e.Note(text, severity):
            return EventDescription(text, severity)
        case e.WorldChanged(change):
            return EventDescription(f"world: {change_text(change)}")
    assert_never(event)


def describe_delta(delta: d.GraphDelta) -> EventDescription:
    """Describe a change of the map in words, with its cause in brackets."""
    match delta:
        case d.NodeAdded(node, cause):
            return EventDescription(f"node {node.id} added ({cause})", node=node.id)
        case d.NodeDropped(node, cause):
            return EventDescription(f"node {node} dropped ({cause})", e.Severity.WARN, node=node)
        case d.EdgeAdded(edge, cause):
            ends = edge.source, edge.target
            origin = " by odometry" if edge.by_odometry else ""
            return EventDescription(f"{edge_text(ends)} added{origin}, p {edge.belief.p:.2f} ({cause})", edge=ends)
        case d.BeliefUpdated(source, target, belief, attempts, successes, cause):
            ends = source, target
            counts = f"{successes} of {count_text(attempts, 'attempt')} succeeded"
            return EventDescription(f"{edge_text(ends)} has p {belief.p:.2f}, {counts} ({cause})", edge=ends)
        case d.EdgePruned(source, target, cause):
            ends = source, target
            return EventDescription(f"{edge_text(ends)} pruned ({cause})", e.Severity.WARN, edge=ends)
        case d.EdgeProtected(source, target, protected, cause):
            ends = (source, target)
            change = "protected" if protected else "no longer protected"
            return EventDescription(f"{edge_text(ends)} {change} ({cause})", edge=ends)
        case d.EdgeActionSet(source, target, action, cause):
            ends = (source, target)
            change = f"needs the action {action!r}" if action else "is driven, without an action"
            return EventDescription(f"{edge_text(ends)} {change} ({cause})", edge=ends)
        case d.PresenceObserved(source, target, present, _, cause):
            ends = (source, target)
            severity = e.Severity.INFO if present else e.Severity.WARN
            return EventDescription(
                f"{edge_text(ends)} seen {'open' if present else 'blocked'} ({cause})", severity, ends
            )
        case d.NodeNamed(node, name, goal, cause):
            named = f"named {name!r}" if name else "without a name"
            return EventDescription(f"node {node} {named}{', a goal' if goal else ''} ({cause})", node=node)
        case d.DriveBegun(frame, name, cause):
            return EventDescription(f"images from {frame} on are of the drive {name!r} ({cause})")
        case d.FramesReserved(frames, cause):
            return EventDescription(f"{count_text(len(frames), 'image')} joined the reserve ({cause})")
        case d.FramesReleased(frames, cause):
            return EventDescription(f"{count_text(len(frames), 'image')} left the reserve ({cause})")
    assert_never(delta)


def edge_text(edge: EdgeKey) -> str:
    """Return the name of an edge."""
    return f"edge {edge[0]} → {edge[1]}"


def _localised(event: e.Localised) -> EventDescription:
    if event.node is None:
        away = f"the best node is {event.distance:.2f} away" if math.isfinite(event.distance) else "the map is empty"
        return EventDescription(f"lost: {away} ({event.scope})", e.Severity.WARN)
    second = "" if event.runner_up is None else f", margin {event.margin:.2f} to node {event.runner_up}"
    sure = "" if event.probability is None else f", place probability {event.probability:.0%}"
    numbers = f"distance {event.distance:.2f}, reachability {event.reachability:.2f}{second}{sure}"
    return EventDescription(f"at node {event.node}: {numbers} ({event.scope})", node=event.node)


def _planned(event: e.Planned) -> EventDescription:
    if not event.nodes:
        return EventDescription("no path to the goal", e.Severity.WARN)
    path = f"{count_text(len(event.nodes), 'node')}, cost {event.cost:.2f}: {_path(event.nodes)}"
    return EventDescription(f"plan of {path}")


def _path(nodes: Sequence[NodeId]) -> str:
    if len(nodes) > _MAX_NODES:
        return " → ".join([*map(str, nodes[: _MAX_NODES - 2]), "...", str(nodes[-1])])
    return " → ".join(map(str, nodes))


def _attempt(event: e.AttemptStarted | e.AttemptEnded) -> str:
    edge = _driven_edge(event)
    return f"attempt {event.attempt} " + (f"to node {event.target}" if edge is None else f"along {edge_text(edge)}")


def _driven_edge(event: e.AttemptStarted | e.AttemptEnded) -> EdgeKey | None:
    return None if event.source is None else (event.source, event.target)
