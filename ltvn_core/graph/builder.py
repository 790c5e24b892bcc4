"""Algorithm 1: a sparse map from a trajectory.

Owns the passes over the images. Every image is encoded once and meets every node at most once. Does not own the two
operators (`graph.operators`) nor the map itself: it returns deltas.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from ltvn_core.config import Method
from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import Cause, FramesReserved, GraphDelta, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from ltvn_core.graph.operators import OperatorThresholds, connectable, mergeable, node_from_observation, node_with_edges
from ltvn_core.types import FrameId, NodeId, Observation, Predictor, is_usable

log = logging.getLogger(__name__)

_MERGE_CANDIDATES = 3
_NEAR_IN_TIME = 12

ProgressCallback = Callable[[int, int], None]
"""Called with images done and images in all."""


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

    Puts the images into `keyframes` and afterwards drops those that are neither nodes nor in reserve. Frames in `goals`
    never merge. Images without depth are left out where the predictor needs it. Raises MapError as `usable_trajectory`.
    """
    observations = usable_trajectory(observations, predictor, goals)
    keyframes.add(observations)
    matcher, odometry_gate = Matcher(predictor, keyframes, method.matching), OdometryGate(observations, method.building)
    loop_closures = LoopClosureVerifier(matcher)
    best: _BuildRun | None = None
    for start in _starts(observations, goals, method.building.restarts, rng):
        attempt = _BuildRun(matcher, odometry_gate, loop_closures, method, goals)
        attempt.run(start, observations, rng, progress or _no_progress)
        if best is None or len(attempt.nodes) > len(best.nodes):
            best = attempt
        if best.coverage(observations) >= method.building.tiny_share:
            break
    assert best is not None
    keyframes.keep_only([*best.nodes, *best.reserve])
    return best.finish()


def _no_progress(done: int, total: int) -> None:
    """Show no progress."""


def check_trajectory(observations: Sequence[Observation], goals: Collection[FrameId] = ()) -> None:
    """Raise MapError for an empty trajectory, frame numbers that repeat, and goals that are not frames."""
    if not observations:
        raise MapError("The trajectory is empty; drive and record some images before building a map.")
    frames = [seen.step for seen in observations]
    if len(set(frames)) != len(frames):
        raise MapError("Frame numbers repeat in the trajectory; each image needs its own.")
    if unknown := set(goals) - set(frames):
        raise MapError(f"The goal frames {sorted(unknown)[:5]} are not in the trajectory.")


def usable_trajectory(
    observations: Sequence[Observation], predictor: Predictor, goals: Collection[FrameId] = ()
) -> Sequence[Observation]:
    """Return the images of a trajectory that a predictor can compare, and log how many it cannot.

    Raises:
        MapError: As `check_trajectory`; or no image has the depth that the predictor needs, or a goal has none.
    """
    check_trajectory(observations, goals)
    usable = [seen for seen in observations if is_usable(seen, predictor)]
    if len(usable) == len(observations):
        return observations
    left_out = [seen.step for seen in observations if not is_usable(seen, predictor)]
    if not usable:
        raise MapError(
            f"None of the {len(observations)} images has depth, and the predictor needs it. Is the depth camera "
            "running? Drive again with it, or use a predictor that works from colours alone."
        )
    if blind := sorted(set(goals) & set(left_out)):
        raise MapError(f"The goal frames {blind[:5]} have no depth, which the predictor needs; choose other goals.")
    log.warning(
        "%d of %d images have no depth (the first is frame %d); the map is built without them.",
        len(left_out),
        len(observations),
        left_out[0],
    )
    return usable


def _starts(
    observations: Sequence[Observation], goals: Collection[FrameId], restarts: int, rng: np.random.Generator
) -> list[Observation]:
    """Pick the first node and those to try instead, goals first."""
    order = [observations[k] for k in rng.permutation(len(observations))]
    order.sort(key=lambda seen: seen.step not in goals)
    return order[: restarts + 1]


class _BuildRun:
    """One run of Algorithm 1 from one start."""

    def __init__(
        self,
        matcher: Matcher,
        odometry_gate: OdometryGate,
        loop_closures: LoopClosureVerifier,
        method: Method,
        goals: Collection[FrameId],
    ) -> None:
        self._matcher, self._loop_closures = matcher, loop_closures
        self._odometry_gate = odometry_gate
        self._method = method
        self._thresholds = OperatorThresholds.building(method.building)
        second = method.building.second_pass_reachability or method.building.connect_reachability
        self._second_pass_thresholds = replace(self._thresholds, connect_reachability=second)
        self._goals = set(goals)
        self._deltas: list[GraphDelta] = []
        self.nodes: dict[FrameId, None] = {}
        self._merged: list[FrameId] = []
        self._left: list[Observation] = []
        self._met: dict[FrameId, int] = {}
        self._known: dict[FrameId, Matches] = {}

    @property
    def reserve(self) -> tuple[FrameId, ...]:
        """T' after the run: images never connected, and merged ones if they are kept."""
        merged = self._merged if self._method.building.keep_merged else []
        return tuple(sorted([*(seen.step for seen in self._left), *merged]))

    def coverage(self, observations: Sequence[Observation]) -> float:
        """Return the share of the images that are nodes or look like one."""
        return (len(self.nodes) + len(self._merged)) / len(observations)

    def finish(self) -> tuple[GraphDelta, ...]:
        """Return the history of the run."""
        reserved = [FramesReserved(self.reserve, Cause.BUILD)] if self.reserve else []
        return (*self._deltas, *reserved)

    def run(
        self,
        start: Observation,
        observations: Sequence[Observation],
        rng: np.random.Generator,
        progress: ProgressCallback,
    ) -> None:
        """Pass over the images until a pass adds nothing, then once more with the lower cut."""
        self._enter([NodeAdded(node_from_observation(start), Cause.BUILD)])
        self._left = [seen for seen in observations if seen is not start]
        second = False
        while True:
            before = len(self.nodes)
            self._pass(rng, progress, len(observations), second=second)
            if len(self.nodes) > before:
                continue
            if second or not self._method.building.second_pass_reachability:
                return
            second = True

    def _pass(self, rng: np.random.Generator, progress: ProgressCallback, total: int, *, second: bool) -> None:
        order = [self._left[k] for k in rng.permutation(len(self._left))]
        order.sort(key=lambda seen: seen.step not in self._goals)
        left = []
        for k, seen in enumerate(order):
            if not self._consumed(seen, second=second):
                left.append(seen)
            progress(total - len(order) + k + 1 - len(left), total)
        self._left = left

    def _consumed(self, seen: Observation, *, second: bool) -> bool:
        """Merge or connect an image; tell whether it is dealt with."""
        for fresh in self._not_met(seen.step):
            found = self._matcher.match(self._matcher.keyframes.features([seen.step]), fresh)
            found = found.take(self._odometry_gate.plausible(seen.step, found))
            if seen.step not in self._goals and self._merges(found, seen.step):
                self._merged.append(seen.step)
                return True
            self._remember(seen.step, found)
        known = self._known[seen.step]
        thresholds = self._second_pass_thresholds if second else self._thresholds
        near = connectable(known, thresholds)
        trusted = self._matcher.with_mutual_support(known.take(near), seen.step)
        trusted = self._loop_closures.verified(seen.step, trusted, connectable(trusted, thresholds))
        chosen = trusted.take(connectable(trusted, thresholds))
        if second:
            best = np.argsort(-chosen.reachability, kind="stable")
            chosen = chosen.take(best[: self._method.building.second_pass_edges])
        if len(chosen):
            self._enter(node_with_edges(seen, chosen, self._method.believing, Cause.BUILD))
            return True
        known.reachability[near] = trusted.reachability  # What was compared in full once stays decided.
        return False

    def _not_met(self, frame: FrameId) -> tuple[tuple[NodeId, ...], ...]:
        """Return the nodes that came since the last time, those near in time first: most images merge with these."""
        nodes = tuple(self.nodes)
        fresh = self._odometry_gate.may_be_near(frame, nodes[self._met.get(frame, 0) :])
        self._met[frame] = len(nodes)
        if len(fresh) <= 2 * _NEAR_IN_TIME:
            return (fresh,)
        ordered = sorted(fresh, key=lambda node: abs(node - frame))
        return tuple(ordered[:_NEAR_IN_TIME]), tuple(ordered[_NEAR_IN_TIME:])

    def _remember(self, frame: FrameId, found: Matches) -> None:
        found = found.take(connectable(found, self._second_pass_thresholds))
        self._known[frame] = self._known[frame].concatenated(found) if frame in self._known else found

    def _merges(self, found: Matches, frame: FrameId) -> bool:
        alike = found.take(mergeable(found, self._thresholds))
        # One after the other, because temporal support is dear and the nearest nearly always has it.
        for k in np.argsort(alike.distances, kind="stable")[:_MERGE_CANDIDATES]:
            if mergeable(self._matcher.with_mutual_support(alike.take(np.array([k])), frame), self._thresholds).any():
                return True
        return False

    def _enter(self, deltas: Sequence[GraphDelta]) -> None:
        self._deltas.extend(deltas)
        self.nodes.update((delta.node.id, None) for delta in deltas if isinstance(delta, NodeAdded))
