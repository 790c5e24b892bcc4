"""Algorithm 1: a sparse map from a trajectory.

Owns the passes over the images. Every image is encoded once and compared with every node at most once. Does not own the
two operators (`graph.operators`) nor the map itself: it returns deltas.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from enum import Enum, auto

import numpy as np

from ltvn_core.config import Method
from ltvn_core.geometry import relative
from ltvn_core.graph.bridges import Bridge, BridgeSearch
from ltvn_core.graph.connectivity import strongly_connected_components
from ltvn_core.graph.corrections import Correction
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, FramesReserved, GraphDelta, NodeAdded
from ltvn_core.graph.drive_closures import with_closed_loops
from ltvn_core.graph.floor_edges import floor_edges
from ltvn_core.graph.free_floor import FreeFloor
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import (
    OperatorThresholds,
    connectable,
    nearest_mergeable,
    node_from_observation,
    node_with_edges,
)
from ltvn_core.graph.slip_check import SlipCheck
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.graph.trajectory import odometry_of, usable_trajectory
from ltvn_core.graph.wheel_slips import without_slips
from ltvn_core.types import FrameId, NodeId, Observation, Predictor

_NEAR_IN_TIME = 12

ProgressCallback = Callable[[int, int], None]
"""Called with the number of images done and the number of all images."""
_CLOSING_SHARE, _FLOOR_SHARE = 0.3, 0.2
"""Shares of the work that correct odometry, and that search for edges over free floor."""


def build(
    observations: Sequence[Observation],
    keyframes: KeyframeStore,
    predictor: Predictor,
    method: Method,
    rng: np.random.Generator,
    *,
    goals: Collection[FrameId] = (),
    progress: ProgressCallback | None = None,
) -> tuple[GraphDelta, ...]:
    """Return the deltas that build a map from a trajectory, Algorithm 1.

    The robust method first corrects odometry for wheel slips and by loop closures, and stores the corrected odometry in
    `keyframes`. Images of several drives are joined where they recognise each other, or by odometry where a drive
    continues the odometry of the one before; `keyframes` knows the first frame of each drive. Adds the images to
    `keyframes`, and afterwards drops those that are neither nodes nor in the reserve. Frames in `goals` never merge.
    Images without depth are left out if the predictor needs depth. Raises MapError as `usable_trajectory`.
    """
    observations = usable_trajectory(observations, predictor, goals)
    keyframes.add(observations)
    matcher = Matcher(predictor, keyframes, method.matching)
    if method.matching.mend_slips:
        check = SlipCheck(matcher)
        mended = without_slips(observations, predictor.camera, keyframes.odometry_starts, check.confirms)
        if check.errors:
            moved = odometry_of(mended) - odometry_of(observations)
            slips = Correction.of("wheel slips", moved, np.concatenate(check.errors), count=len(check.errors))
            keyframes.corrections.append(slips)
        observations = mended
        keyframes.correct(observations)
    loop_closures = LoopClosureVerifier(matcher)
    count = len(observations)
    tell = progress or _no_progress
    observations, odometry_gate = with_closed_loops(
        observations, matcher, loop_closures, method, lambda share: tell(round(_CLOSING_SHARE * share * count), count)
    )
    closing = _CLOSING_SHARE if method.building.close_loops else 0.0
    before_floor = 1 - _FLOOR_SHARE if method.building.floor_edges else 1.0
    run = _BuildRun(observations, matcher, odometry_gate, loop_closures, method, goals)
    run.run(rng, lambda done, total: tell(round(closing * total + (before_floor - closing) * done), total))
    run.keep_largest_pieces()
    keyframes.keep_only([*run.nodes, *run.reserve])
    deltas = run.finish()
    _note_edges("bridges by odometry", deltas, deltas, keyframes)
    if not method.building.floor_edges:
        return deltas
    images = [keyframes.observation(node) for node in run.nodes]
    floor = FreeFloor(images, predictor.camera, odometry_gate, keyframes.needed_space(predictor.camera))
    edges = [
        *floor_edges(
            TopologicalGraph(deltas),
            odometry_gate,
            floor,
            method,
            lambda share: tell(round((before_floor + _FLOOR_SHARE * share) * count), count),
        )
    ]
    _note_edges("edges over free floor", edges, deltas, keyframes)
    deltas = (*deltas, *edges)
    tell(count, count)
    return deltas


def _note_edges(what: str, added: Sequence[GraphDelta], deltas: Sequence[GraphDelta], keyframes: KeyframeStore) -> None:
    """Note the edges that only odometry vouches for, with the error of odometry by the edges between recognised
    images."""
    by_odometry = [delta.edge for delta in added if isinstance(delta, EdgeAdded) and delta.edge.by_odometry]
    if not by_odometry:
        return
    seen = [delta.edge for delta in deltas if isinstance(delta, EdgeAdded) and not delta.edge.by_odometry]
    seen = [edge for edge in seen if keyframes.drive_of(edge.source) == keyframes.drive_of(edge.target)]
    ends = [odometry_of([keyframes.observation(end) for end in part]) for part in zip(*map(_ends, seen), strict=True)]
    errors = relative(np.array([edge.waypoint for edge in seen]), relative(*ends)) if seen else np.empty((0, 3))
    lengths = np.array([edge.waypoint for edge in by_odometry])
    keyframes.corrections.append(Correction.of(what, lengths, errors, count=len(by_odometry)))


def _ends(edge: Edge) -> tuple[NodeId, NodeId]:
    return edge.source, edge.target


def _no_progress(done: int, total: int) -> None:
    """Show no progress."""


class _Stage(Enum):
    """How an image may enter the map."""

    FIRST = auto()
    """Algorithm 1: it merges with a node, or is connected with nodes."""
    SECOND = auto()
    """It may also be connected at the lower threshold of r."""
    BRIDGES = auto()
    """It may also be connected with merged images, which then become nodes."""


class _BuildRun:
    """One run of Algorithm 1; it starts another piece while the left-over images could form the largest one."""

    def __init__(
        self,
        observations: Sequence[Observation],
        matcher: Matcher,
        odometry_gate: OdometryGate,
        loop_closures: LoopClosureVerifier,
        method: Method,
        goals: Collection[FrameId],
    ) -> None:
        self._observations = observations
        self._matcher = matcher
        self._loop_closures = loop_closures
        self._odometry_gate = odometry_gate
        self._method = method
        self._thresholds = OperatorThresholds.building(method.building)
        second = method.building.second_pass_reachability or method.building.connect_reachability
        self._second_pass_thresholds = replace(self._thresholds, connect_reachability=second)
        self._bridges = BridgeSearch(observations, matcher, odometry_gate, loop_closures, self._second_pass_thresholds)
        self._goals = set(goals)
        self._deltas: list[GraphDelta] = []
        self.nodes: dict[FrameId, None] = {}
        self._merged: dict[FrameId, Matches] = {}
        self._left = list(observations)
        self._met: dict[FrameId, int] = {}
        self._known: dict[FrameId, Matches] = {}

    @property
    def reserve(self) -> tuple[FrameId, ...]:
        """T' after the run: images never connected, and merged ones if they are kept."""
        merged = self._merged if self._method.building.keep_merged else []
        return tuple(sorted([*(seen.step for seen in self._left), *merged]))

    def finish(self) -> tuple[GraphDelta, ...]:
        """Return the history of the run."""
        reserved = [FramesReserved(self.reserve, Cause.BUILD)] if self.reserve else []
        return (*self._deltas, *reserved)

    def run(self, rng: np.random.Generator, progress: ProgressCallback) -> None:
        """Pass over the images until a pass adds nothing, then with the lower threshold of r, then with bridges; then
        start another piece.

        An image that cannot be joined cuts off all images behind it. With a single start, chance would decide whether
        the map is the largest piece of the drive or a small one.
        """
        start: Observation | None = self._first_start(rng)
        while start is not None:
            self._enter([NodeAdded(node_from_observation(start), Cause.BUILD)])
            self._left = [seen for seen in self._left if seen is not start]
            self._grow_all(rng, progress)
            start = self._start_elsewhere(rng)

    def keep_largest_pieces(self) -> None:
        """Drop each piece of the map that is not the largest piece of any drive; its images are left over again."""
        pieces = self._pieces()
        drive_of = self._matcher.keyframes.drive_of
        drives = {drive_of(seen.step) for seen in self._observations}
        kept = set[FrameId]().union(
            *(max(pieces, key=lambda piece: sum(drive_of(frame) == drive for frame in piece)) for drive in drives)
        )
        dropped = set[FrameId]().union(*pieces) - kept
        if not dropped:
            return
        self._deltas = [delta for delta in self._deltas if _added_node(delta) not in dropped]
        self.nodes = {node: None for node in self.nodes if node in kept}
        self._merged = {frame: found for frame, found in self._merged.items() if frame in kept}
        self._left += [seen for seen in self._observations if seen.step in dropped]

    def _first_start(self, rng: np.random.Generator) -> Observation:
        """Draw the first node, one of the goals if there are any."""
        order = [self._observations[k] for k in rng.permutation(len(self._observations))]
        return min(order, key=lambda seen: seen.step not in self._goals)

    def _start_elsewhere(self, rng: np.random.Generator) -> Observation | None:
        """Draw an image that starts another piece of the map; None if no other piece is needed.

        The image is drawn from the drives that have no image in the map yet. Otherwise it is drawn from all left-over
        images, if these outnumber the images of the largest piece.
        """
        drive_of = self._matcher.keyframes.drive_of
        placed = {drive_of(frame) for frame in (*self.nodes, *self._merged)}
        left = [seen for seen in self._left if drive_of(seen.step) not in placed]
        if not left and self._method.building.largest_piece and len(self._left) > len(self._pieces()[0]):
            left = self._left
        return left[rng.integers(len(left))] if left else None

    def _pieces(self) -> list[set[FrameId]]:
        """Return the nodes of each piece with the images that merged with them, the largest piece first."""
        pieces = [set(piece) for piece in strongly_connected_components(TopologicalGraph(self._deltas))]
        merged = [(frame, int(found.nodes[0])) for frame, found in self._merged.items()]
        for piece in pieces:
            piece.update([frame for frame, node in merged if node in piece])
        return sorted(pieces, key=len, reverse=True)

    def _grow_all(self, rng: np.random.Generator, progress: ProgressCallback) -> None:
        config = self._method.building
        self._grow(_Stage.FIRST, rng, progress)
        if not config.second_pass_reachability:
            return
        self._grow(_Stage.SECOND, rng, progress)
        if not config.bridges:
            return
        self._grow(_Stage.BRIDGES, rng, progress)
        while chain := self._bridges_by_odometry():
            for bridge in chain:
                self._cross(bridge)
            self._left = [seen for seen in self._left if seen.step not in self.nodes]
            self._grow(_Stage.BRIDGES, rng, progress)

    def _bridges_by_odometry(self) -> tuple[Bridge, ...]:
        left = {seen.step for seen in self._left}
        return self._bridges.by_odometry(left, self.nodes.keys() | self._merged.keys(), self._goals)

    def _grow(self, stage: _Stage, rng: np.random.Generator, progress: ProgressCallback) -> None:
        """Pass over the images until a pass adds no node; in the last stage, until a pass neither adds a node nor
        merges an image."""
        before = -1
        while (grown := len(self.nodes) + (len(self._merged) if stage is _Stage.BRIDGES else 0)) > before:
            before = grown
            self._pass(stage, rng, progress)

    def _pass(self, stage: _Stage, rng: np.random.Generator, progress: ProgressCallback) -> None:
        total = len(self._observations)
        order = [self._left[k] for k in rng.permutation(len(self._left))]
        order.sort(key=lambda seen: seen.step not in self._goals)
        left = []
        for k, seen in enumerate(order):
            if not self._consumed(seen, stage):
                left.append(seen)
            progress(total - len(order) + k + 1 - len(left), total)
        self._left = left

    def _consumed(self, seen: Observation, stage: _Stage) -> bool:
        """Merge, connect or bridge an image; tell whether one of these succeeded."""
        for fresh in self._not_met(seen.step):
            found = self._matcher.match(self._matcher.keyframes.features([seen.step]), fresh)
            found = found.take(self._odometry_gate.plausible(seen.step, found))
            if (
                seen.step not in self._goals
                and (merging := nearest_mergeable(seen.step, found, self._matcher, self._thresholds)) is not None
            ):
                self._merged[seen.step] = merging
                return True
            self._remember(seen.step, found)
        known = self._known[seen.step]
        thresholds = self._thresholds if stage is _Stage.FIRST else self._second_pass_thresholds
        near = connectable(known, thresholds)
        trusted = self._loop_closures.supported(seen.step, known.take(near), thresholds)
        chosen = trusted.take(connectable(trusted, thresholds))
        if stage is not _Stage.FIRST:
            best = np.argsort(-chosen.reachability, kind="stable")
            chosen = chosen.take(best[: self._method.building.second_pass_edges])
        if len(chosen):
            self._enter(node_with_edges(seen, chosen, self._method.believing, Cause.BUILD))
            return True
        known.reachability[near] = trusted.reachability  # A pair is compared in full only once.
        bridge = self._bridges.by_merged_image(seen.step, self._merged) if stage is _Stage.BRIDGES else None
        if bridge is not None:
            self._cross(bridge)
        return bridge is not None

    def _cross(self, bridge: Bridge) -> None:
        """Make a left-over image a node, and also the merged image that it is bridged to."""
        (other,) = bridge.matches.nodes
        keyframes = self._matcher.keyframes
        config = self._method.believing
        if other in self._merged:
            merging = self._merged.pop(other)
            self._enter(node_with_edges(keyframes.observation(other), merging, config, Cause.BUILD))
        seen = keyframes.observation(bridge.frame)
        self._enter(node_with_edges(seen, bridge.matches, config, Cause.BUILD, by_odometry=bridge.by_odometry))

    def _not_met(self, frame: FrameId) -> Iterator[tuple[NodeId, ...]]:
        """Yield the nodes that a frame was not compared with yet, those near in time first, because most images merge
        with one of these.

        If there are many other nodes, only those that may look like the frame are included.
        """
        nodes = tuple(self.nodes)
        fresh = self._odometry_gate.may_be_near(frame, nodes[self._met.get(frame, 0) :])
        self._met[frame] = len(nodes)
        if len(fresh) <= 2 * _NEAR_IN_TIME:
            yield fresh
            return
        ordered = sorted(fresh, key=lambda node: abs(node - frame))
        yield tuple(ordered[:_NEAR_IN_TIME])
        yield self._matcher.promising(frame, ordered[_NEAR_IN_TIME:])

    def _remember(self, frame: FrameId, found: Matches) -> None:
        found = found.take(connectable(found, self._second_pass_thresholds))
        self._known[frame] = self._known[frame].concatenated(found) if frame in self._known else found

    def _enter(self, deltas: Sequence[GraphDelta]) -> None:
        self._deltas.extend(deltas)
        self.nodes.update((delta.node.id, None) for delta in deltas if isinstance(delta, NodeAdded))


def _added_node(delta: GraphDelta) -> NodeId | None:
    """Return the node that a delta adds, or from which it adds an edge."""
    match delta:
        case NodeAdded(node=node):
            return node.id
        case EdgeAdded(edge=edge):
            return edge.source
        case _:
            return None
