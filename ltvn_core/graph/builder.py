"""Algorithm 1: a sparse map from a trajectory.

Owns the passes over the images. Every image is encoded once and compared with every node at most once. Does not own the
two operators (`graph.operators`) nor the map itself: it returns deltas.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from enum import IntEnum, auto

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import DisjointSet

from ltvn_core.config import Method
from ltvn_core.graph import loop_closures
from ltvn_core.graph.bridges import Bridge, BridgeSearch
from ltvn_core.graph.build_progress import BuildProgress, BuildStage, ProgressCallback
from ltvn_core.graph.corrections import Correction
from ltvn_core.graph.deltas import Cause, EdgeAdded, FramesReserved, GraphDelta, NodeAdded
from ltvn_core.graph.drive_closures import odometry_errors, with_closed_loops
from ltvn_core.graph.floor_edges import floor_edges
from ltvn_core.graph.free_floor import FreeFloor
from ltvn_core.graph.keyframes import KeyframeStore, usable_trajectory
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import DriveLink, Newcomers, OdometryGate
from ltvn_core.graph.operators import connectable, nearest_mergeable, node_from_observation, node_with_edges
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.graph.wheel_slips import mend_slips
from ltvn_core.types import FrameId, NodeId, Observation, Predictor

SECOND_PASS_REACHABILITY = 0.6
"""Least r of an edge of an image left over after Algorithm 1: below R_c, because no other edge joins the image."""
_SECOND_PASS_EDGES = 2
"""Maximum number of edges of such an image, the most reachable ones first."""
_NEAR_IN_TIME = 12
_ENCODED_AT_ONCE = 64


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
    shown = BuildProgress(method, len(observations), progress)
    encoded = shown.of(BuildStage.ENCODING)
    for first in range(0, len(observations), _ENCODED_AT_ONCE):
        keyframes.add(observations[first : first + _ENCODED_AT_ONCE])
        encoded(min(first + _ENCODED_AT_ONCE, len(observations)) / len(observations))
    matcher = Matcher(predictor, keyframes, method.matching)
    if method.matching.mend_slips:
        observations = mend_slips(observations, matcher, shown.of(BuildStage.SLIPS))
    observations, odometry_gate = with_closed_loops(
        observations, matcher, method.building, shown.of(BuildStage.CLOSURES)
    )
    run = _BuildRun(observations, matcher, odometry_gate, method, goals)
    deltas = run.run(rng, shown.of(BuildStage.PASSES))
    keyframes.keep_only([*run.nodes, *run.reserve])
    _note_edges("bridges by odometry", deltas, deltas, keyframes)
    if method.building.floor_edges:
        images = [keyframes.observation(node) for node in run.nodes]
        floor = FreeFloor(images, predictor.camera, odometry_gate, keyframes.needed_space(predictor.camera))
        graph = TopologicalGraph(deltas)
        edges = [*floor_edges(graph, odometry_gate, floor, method, shown.of(BuildStage.FLOOR))]
        _note_edges("edges over free floor", edges, deltas, keyframes)
        deltas = (*deltas, *edges)
    shown.end()
    return deltas


def _note_edges(what: str, added: Sequence[GraphDelta], deltas: Sequence[GraphDelta], keyframes: KeyframeStore) -> None:
    """Note the edges that only odometry vouches for, with the error of odometry by the edges between recognised
    images."""
    by_odometry = [delta.edge for delta in added if isinstance(delta, EdgeAdded) and delta.edge.by_odometry]
    if not by_odometry:
        return
    seen = [delta.edge for delta in deltas if isinstance(delta, EdgeAdded) and not delta.edge.by_odometry]
    seen = [edge for edge in seen if keyframes.drive_of(edge.source) == keyframes.drive_of(edge.target)]
    errors = odometry_errors([DriveLink(edge.source, edge.target, np.array(edge.waypoint)) for edge in seen], keyframes)
    lengths = np.array([edge.waypoint for edge in by_odometry])
    keyframes.corrections.append(Correction.of(what, lengths, errors, count=len(by_odometry)))


class _Stage(IntEnum):
    """How an image may enter the map. What the stages before allow, a stage allows too."""

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
        method: Method,
        goals: Collection[FrameId],
    ) -> None:
        self._images = sorted(observations, key=lambda seen: seen.step)
        """All N images; arrays name an image by its row here."""
        self._row = {seen.step: row for row, seen in enumerate(self._images)}
        self._drive = np.array([matcher.keyframes.drive_of(seen.step) for seen in self._images])
        self._is_goal = np.isin([*self._row], [*goals])
        self._matcher = matcher
        self._odometry_gate = odometry_gate
        self._method = method
        self._thresholds = method.building
        self._second_pass_thresholds = replace(self._thresholds, connect_reachability=SECOND_PASS_REACHABILITY)
        self._bridges = BridgeSearch(observations, matcher, odometry_gate, self._second_pass_thresholds)
        self._goals = set(goals)
        self._deltas: list[NodeAdded | EdgeAdded] = []
        self.nodes: dict[FrameId, None] = {}
        self._merged: dict[FrameId, Matches] = {}
        self._left = np.array([self._row[seen.step] for seen in observations], np.intp)
        self._waiting = np.zeros((len(_Stage), len(observations)), bool)
        """For each stage and image, whether something changed that the stage allows to use and that was not tried."""
        self._new_nodes = Newcomers(odometry_gate, self._waiting[_Stage.FIRST - 1])
        self._newly_merged = Newcomers(odometry_gate, self._waiting[_Stage.BRIDGES - 1])
        self._known: dict[FrameId, Matches] = {}
        self._pieces = DisjointSet()
        """Nodes and merged images; all edges lead both ways."""
        self._most_in_piece = 0
        self._drives_left = set(self._drive.tolist())
        """Drives without an image in the map."""

    @property
    def reserve(self) -> tuple[FrameId, ...]:
        """T' after the run: images never connected, and merged ones if they are kept."""
        merged = self._merged if self._method.building.keep_merged else []
        return tuple(sorted([*(self._images[row].step for row in self._left), *merged]))

    def run(self, rng: np.random.Generator, progress: Callable[[float], None]) -> tuple[GraphDelta, ...]:
        """Pass over the images until a pass adds nothing, then with the lower threshold of r, then with bridges; then
        start another piece. Return the history of the largest pieces.

        An image that cannot be joined cuts off all images behind it. With a single start, chance would decide whether
        the map is the largest piece of the drive or a small one.
        """
        start: int | None = int(self._shuffled(rng)[0])
        while start is not None:
            self._enter([NodeAdded(node_from_observation(self._images[start]), Cause.BUILD)])
            self._left = self._left[self._left != start]
            self._grow_all(rng, progress)
            start = self._start_elsewhere(rng)
        self._keep_largest_pieces()
        reserved = [FramesReserved(self.reserve, Cause.BUILD)] if self.reserve else []
        return (*self._deltas, *reserved)

    def _keep_largest_pieces(self) -> None:
        """Drop each piece of the map that is not the largest piece of any drive; its images are left over again."""
        pieces = sorted(self._pieces.subsets(), key=self._largest_first)
        shares = [np.bincount(self._drive[self._rows(piece)], minlength=self._drive.max() + 1) for piece in pieces]
        largest = np.argmax(shares, axis=0)[np.unique(self._drive)]
        kept = set[FrameId]().union(*(pieces[number] for number in largest))
        dropped = set[FrameId]().union(*pieces) - kept
        if not dropped:
            return
        self._deltas = [delta for delta in self._deltas if _added_node(delta) not in dropped]
        self.nodes = {node: None for node in self.nodes if node in kept}
        self._merged = {frame: found for frame, found in self._merged.items() if frame in kept}
        self._left = np.concatenate([self._left, self._rows(dropped)])

    def _largest_first(self, piece: set[FrameId]) -> tuple[int, int, list[NodeId]]:
        nodes = sorted(frame for frame in piece if frame in self.nodes)
        return -len(piece), -len(nodes), nodes

    def _rows(self, frames: Iterable[FrameId]) -> NDArray[np.intp]:
        return np.array([self._row[frame] for frame in frames], np.intp)

    def _shuffled(self, rng: np.random.Generator) -> NDArray[np.intp]:
        """Return the rows of the images left over in random order, goals first."""
        rows = self._left[rng.permutation(len(self._left))]
        return np.concatenate([rows[self._is_goal[rows]], rows[~self._is_goal[rows]]])

    def _start_elsewhere(self, rng: np.random.Generator) -> int | None:
        """Draw an image that starts another piece of the map; None if no other piece is needed.

        The image is drawn from the drives that have no image in the map yet. Otherwise it is drawn from all left-over
        images, if these outnumber the images of the largest piece.
        """
        left = self._left[np.isin(self._drive[self._left], [*self._drives_left])]
        if not len(left) and self._method.building.largest_piece and len(self._left) > self._most_in_piece:
            left = self._left
        return int(left[rng.integers(len(left))]) if len(left) else None

    def _grow_all(self, rng: np.random.Generator, progress: Callable[[float], None]) -> None:
        self._grow(_Stage.FIRST, rng, progress)
        if not self._method.building.bridges:
            return
        self._grow(_Stage.SECOND, rng, progress)
        self._grow(_Stage.BRIDGES, rng, progress)
        rows = np.arange(len(self._images))
        while chain := self._bridges.by_odometry(np.isin(rows, self._left), self._goals):
            for bridge in chain:
                self._cross(bridge)
            crossed = self._rows(bridge.frame for bridge in chain)
            self._left = self._left[~np.isin(self._left, crossed)]
            self._grow(_Stage.BRIDGES, rng, progress)

    def _grow(self, stage: _Stage, rng: np.random.Generator, progress: Callable[[float], None]) -> None:
        """Pass over the images until a pass adds no node; in the last stage, until a pass neither adds a node nor
        merges an image."""
        before = -1
        while (grown := len(self.nodes) + (len(self._merged) if stage is _Stage.BRIDGES else 0)) > before:
            before = grown
            self._pass(stage, rng, progress)

    def _pass(self, stage: _Stage, rng: np.random.Generator, progress: Callable[[float], None]) -> None:
        """Try each left-over image for which something changed, in random order; all others would fail as before.

        Images that enter the map wake others behind them.
        """
        total = len(self._images)
        order = self._shuffled(rng)
        is_left = np.ones(len(order), bool)
        consumed = total - len(order)
        for place, row in enumerate(order.tolist()):
            if self._waiting[:stage, row].any():
                if self._consumed(row, stage):
                    is_left[place] = False
                    consumed += 1
                progress(consumed / total)
        self._left = order[is_left]

    def _consumed(self, row: int, stage: _Stage) -> bool:
        """Merge, connect or bridge an image; tell whether one of these succeeded."""
        seen = self._images[row]
        for fresh in self._not_met(row):
            found = self._matcher.match(self._matcher.keyframes.features([seen.step]), fresh)
            found = found.take(self._odometry_gate.plausible(seen.step, found))
            is_goal = seen.step in self._goals
            merging = None if is_goal else nearest_mergeable(seen.step, found, self._matcher, self._thresholds)
            if merging is not None:
                self._merged[seen.step] = merging
                self._newly_merged.enter(row)
                self._join(seen.step, merging.nodes[0])
                return True
            found = found.take(connectable(found, self._second_pass_thresholds))
            known = self._known.get(seen.step)
            self._known[seen.step] = found if known is None else known.concatenated(found)
        if seen.step in self._known and self._connected(row, stage):
            return True
        if stage is not _Stage.BRIDGES:
            return False
        bridge = self._bridges.by_merged_image(seen.step, self._newly_merged.met_by(row))
        if bridge is not None:
            self._cross(bridge)
        return bridge is not None

    def _connected(self, row: int, stage: _Stage) -> bool:
        """Connect an image with the nodes that it recognised; tell whether that succeeded."""
        seen = self._images[row]
        known = self._known[seen.step]
        thresholds = self._thresholds if stage is _Stage.FIRST else self._second_pass_thresholds
        self._waiting[_Stage.SECOND - 1, row] = stage is _Stage.FIRST
        near = connectable(known, thresholds)
        if not near.any():
            return False
        trusted = loop_closures.supported(seen.step, known.take(near), self._matcher, thresholds)
        chosen = trusted.take(connectable(trusted, thresholds))
        if stage is not _Stage.FIRST:
            best = np.argsort(-chosen.reachability, kind="stable")
            chosen = chosen.take(best[:_SECOND_PASS_EDGES])
        if len(chosen):
            self._enter(node_with_edges(seen, chosen, self._method.believing, Cause.BUILD))
            return True
        known.reachability[near] = trusted.reachability  # A pair is compared in full only once.
        return False

    def _cross(self, bridge: Bridge) -> None:
        """Make a left-over image a node, and also the merged image that it is bridged to."""
        (other,) = bridge.matches.nodes
        keyframes = self._matcher.keyframes
        config = self._method.believing
        if other in self._merged:
            merging = self._merged.pop(other)
            self._newly_merged.leave(self._row[other])
            self._enter(node_with_edges(keyframes.observation(other), merging, config, Cause.BUILD))
        seen = keyframes.observation(bridge.frame)
        self._enter(node_with_edges(seen, bridge.matches, config, Cause.BUILD, by_odometry=bridge.by_odometry))

    def _not_met(self, row: int) -> Iterator[tuple[NodeId, ...]]:
        """Yield the nodes that an image was not compared with yet, those near in time first, because most images merge
        with one of these.

        If there are many other nodes, only those that may look like the image are included.
        """
        frame = self._images[row].step
        nodes = [self._images[other].step for other in self._new_nodes.met_by(row)]
        fresh = self._odometry_gate.may_be_near(frame, nodes)
        if len(fresh) <= 2 * _NEAR_IN_TIME:
            yield fresh
            return
        ordered = sorted(fresh, key=lambda node: abs(node - frame))
        yield tuple(ordered[:_NEAR_IN_TIME])
        yield self._matcher.promising(frame, ordered[_NEAR_IN_TIME:])

    def _enter(self, deltas: Sequence[NodeAdded | EdgeAdded]) -> None:
        self._deltas.extend(deltas)
        for delta in deltas:
            if isinstance(delta, EdgeAdded):
                self._join(delta.edge.source, delta.edge.target)
                continue
            self.nodes[delta.node.id] = None
            self._new_nodes.enter(self._row[delta.node.id])
            self._join(delta.node.id, delta.node.id)

    def _join(self, frame: FrameId, other: FrameId) -> None:
        """Note that an image belongs to the piece of another one, which is in the map or the same image."""
        self._pieces.add(frame)
        self._pieces.merge(frame, other)
        self._most_in_piece = max(self._most_in_piece, self._pieces.subset_size(frame))
        self._drives_left.discard(int(self._drive[self._row[frame]]))


def _added_node(delta: NodeAdded | EdgeAdded) -> NodeId:
    """Return the node that a delta adds, or from which it adds an edge."""
    return delta.node.id if isinstance(delta, NodeAdded) else delta.edge.source
