"""Coverage of a map: the share of its drive that its largest piece knows, and whether paths lead to its goals.

A map holds a goal if paths lead there from most of the map, over edges with p of at least one half. Images are
localised as a robot localises them, so that problems are known before a robot fails. Changes no map.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from itertools import groupby
from typing import NamedTuple, TypeVar

import numpy as np
import rustworkx

from ltvn_core.findings import Finding
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import NO_PRIOR, nearest_nodes
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.planner import mirrored, strongly_connected_components
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId, Observation, Predictor, is_usable

Item = TypeVar("Item")

ASKED = 40
"""Largest number of images without a node that are localised, evenly spaced."""
_LIKELY_P = 0.5
_BESIDE_STEPS = 50
"""Control steps, five seconds of the drive, within which a robot hardly moves on."""
_NEAREST_ASKED = 5
_MOST = 0.5
"""Share of the other nodes from which a path must lead to a goal."""


class Stretch(NamedTuple):
    """A part of a drive, in seconds after its first image."""

    begin_s: float
    end_s: float
    drive: str = ""
    """Name of the drive, where the map has several."""


class MapCoverage(NamedTuple):
    """Share of its own drive that a map recognises."""

    share: float
    """Share of the images that are nodes of the map's largest piece or are recognised as one of them."""
    gap: Stretch | None
    """The longest part of one drive that the piece does not know; None if it knows all."""
    lost: tuple[FrameId, ...] = ()
    """The images that the map does not know, in order."""
    by_images: float = 1.0
    """The same share for the largest piece that edges between recognised images hold together, without those that only
    odometry vouches for."""


def map_coverage(
    observations: Sequence[Observation],
    graph: TopologicalGraph,
    keyframes: KeyframeStore,
    predictor: Predictor,
    system: NavigationSystem,
) -> MapCoverage:
    """Return how much of the images that a map was built from its largest piece knows.

    `observations` are in order, and `keyframes` contains the images of nodes and of the reserve. An image in neither
    has merged and was dropped, so its place is known, unless the predictor cannot use it.
    """
    piece, piece_by_images = (
        set(next(iter(strongly_connected_components(graph, over)), ()))
        for over in (lambda edge: True, lambda edge: not edge.by_odometry)
    )
    in_reserve = [seen.step for seen in observations if seen.step in keyframes and seen.step not in graph.nodes]
    matcher = Matcher(predictor, keyframes, system.method.matching)
    at = {node: node for node in graph.nodes} | {
        frame: system.localise(keyframes.features([frame]), graph, NO_PRIOR, matcher).node
        for frame in evenly(in_reserve, ASKED)
    }
    known, known_by_images = (
        _known(observations, {frame: node in part for frame, node in at.items()}, set(in_reserve), predictor)
        for part in (piece, piece_by_images)
    )
    return MapCoverage(
        share=float(np.mean(known)) if known else 1.0,
        gap=_longest_gap(observations, known, graph),
        lost=tuple(seen.step for seen, is_known in zip(observations, known, strict=True) if not is_known),
        by_images=float(np.mean(known_by_images)) if known_by_images else 1.0,
    )


def evenly(items: Sequence[Item], most: int) -> list[Item]:
    """Return an evenly spread selection of some items in order, limited in number."""
    places = np.unique(np.linspace(0, len(items) - 1, min(len(items), most)).astype(int))
    return [items[place] for place in places.tolist()]


def _known(
    observations: Sequence[Observation], answers: Mapping[FrameId, bool], in_reserve: set[FrameId], predictor: Predictor
) -> list[bool]:
    """Tell for each image whether its place is known.

    A reserved image that was not localised counts like the last one before it that was.
    """
    known = list[bool]()
    last = True
    for seen in observations:
        if seen.step in in_reserve:
            last = answers.get(seen.step, last)
            known.append(last)
        else:
            known.append(answers.get(seen.step, is_usable(seen, predictor)))
    return known


def _longest_gap(observations: Sequence[Observation], known: Sequence[bool], graph: TopologicalGraph) -> Stretch | None:
    """Return the longest unknown part of one drive; the time between two drives does not count."""
    gaps = list[Stretch]()
    begun_s = dict[int, float]()
    names = dict(enumerate(graph.drives.values(), 1)) if len(graph.drives) > 1 else {}
    drives = [graph.drive_of(seen.step) for seen in observations]
    for seen, drive in zip(observations, drives, strict=True):
        begun_s.setdefault(drive, seen.stamp)
    for (is_known, drive), run in groupby(range(len(known)), key=lambda row: (known[row], drives[row])):
        if not is_known:
            stamps = [observations[row].stamp - begun_s[drive] for row in run]
            gaps.append(Stretch(stamps[0], stamps[-1], names.get(drive, "")))
    return max(gaps, key=lambda gap: gap.end_s - gap.begin_s, default=None)


class Standing(StrEnum):
    """Whether paths of a map lead to a goal."""

    HELD = "held"
    UNSURE = "unsure"
    """Paths lead there from most of the map, but some of their edges have p below one half."""
    NOT_HELD = "not held"
    """The goal is not a node, or no paths lead there from most of the map."""


class GoalReport(NamedTuple):
    """Report of a map about a goal."""

    goal: FrameId
    standing: Standing
    nearest: NodeId | None = None
    """Node to drive to instead of the goal: one taken shortly before or after it on the drive, else the most similar
    one. None if there is no such node, or if paths lead to the goal."""
    reachability: float = 0.0
    """r of that node seen from the goal, in [0, 1]."""

    @property
    def finding(self) -> Finding | None:
        """The problem; None if the map contains the goal."""
        goal = f"goal {self.goal}"
        if self.standing is Standing.HELD:
            return None
        if self.standing is Standing.UNSURE:
            return Finding(
                f"The map is not sure of {goal}: every path there has an edge with p below 0.5.",
                remedy="The robot may try; driving this path once more makes the map sure.",
                where=goal,
            )
        instead = "" if self.nearest is None else f" Nearest to it is node {self.nearest}, r = {self.reachability:.2f}."
        return Finding(
            f"The map does not contain {goal}: no path leads there from most of the map.{instead}",
            remedy="Go there instead, or drive past the goal once more, slowly.",
            where=goal,
        )


def standings(graph: TopologicalGraph, goals: Sequence[FrameId]) -> tuple[Standing, ...]:
    """Return for each goal whether paths lead there from most of the map; linear in edges for each goal."""
    likely = reached_from_most(graph, goals, lambda edge: edge.belief.p >= _LIKELY_P)
    every = reached_from_most(graph, goals)
    found = {True: Standing.HELD, False: Standing.UNSURE}
    return tuple(found[sure] if any_way else Standing.NOT_HELD for sure, any_way in zip(likely, every, strict=True))


def goal_reports(
    graph: TopologicalGraph,
    goals: Sequence[FrameId],
    keyframes: KeyframeStore,
    predictor: Predictor,
    system: NavigationSystem,
) -> tuple[GoalReport, ...]:
    """Return the report of a map on each goal; `keyframes` contains the images of the map's nodes, and those of most
    goals."""
    matcher = Matcher(predictor, keyframes, system.method.matching)
    reports = list[GoalReport]()
    for goal, standing in zip(goals, standings(graph, goals), strict=True):
        if standing is not Standing.NOT_HELD or goal not in keyframes:
            reports.append(GoalReport(goal, standing))
            continue
        features = keyframes.features([goal])
        held = _held(graph, _beside(graph, goal))
        if not held:  # Another place may look more similar than the goal's own, so this comes second.
            held = _held(graph, [node for node, _ in nearest_nodes(features, graph, _NEAREST_ASKED, matcher)])
        if not held:
            reports.append(GoalReport(goal, standing))
            continue
        seen = matcher.match(features, held[:1])
        reports.append(GoalReport(goal, standing, held[0], float(seen.reachability[0])))
    return tuple(reports)


def _beside(graph: TopologicalGraph, goal: FrameId) -> list[NodeId]:
    """Return the nodes that were taken shortly before or after a goal on the same drive, nearest in time first."""
    near = [node for node in graph.nodes if abs(node - goal) <= _BESIDE_STEPS]
    same = [node for node in near if graph.drive_of(node) == graph.drive_of(goal)]
    return sorted(same, key=lambda node: abs(node - goal))[:_NEAREST_ASKED]


def _held(graph: TopologicalGraph, nodes: Sequence[NodeId]) -> list[NodeId]:
    return [node for node, way in zip(nodes, standings(graph, nodes), strict=True) if way is Standing.HELD]


def reached_from_most(
    graph: TopologicalGraph, goals: Sequence[FrameId], over: Callable[[Edge], bool] = lambda edge: True
) -> list[bool]:
    """Tell for each goal whether it is a node and paths lead there from half of the other nodes, over the edges that
    `over` accepts."""
    mirror, index = mirrored(graph, (key for key, edge in graph.edges.items() if over(edge)))
    enough = _MOST * (len(index) - 1)
    return [goal in index and len(rustworkx.ancestors(mirror, index[goal])) >= enough for goal in goals]
