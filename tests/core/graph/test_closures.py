"""Two stretches of driving meet where they are said to meet, or the match is not believed."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ltvn_core.config import ROBUST, MatchingConfig, Method
from ltvn_core.data.recording.info import read_info
from ltvn_core.geometry import compose, relative
from ltvn_core.graph import loop_closures
from ltvn_core.graph.builder import build
from ltvn_core.graph.corrections import UnsurePlaces
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.built_map import build_map
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.types import Features, FrameId, Observation, Pose, Tilt
from tests.core.flat_world import FlatPredictor, observation_at, one_room, tour

FIRST = [observation_at(np.array([0.5 + 0.3 * k, 1.0, 0.0]), k) for k in range(12)]
SECOND = [observation_at(np.array([0.5 + 0.3 * k, 1.2, 0.0]), 100 + k) for k in range(12)]
"""Two passes through a room, side by side."""
TRUE, FALSE = (2, 102), (2, 109)
LIE = np.array([0.1, 0.0, 0.0])
WRONG = np.array([2.0, 0.0, 0.0])


def matcher(*, reach: int = 10) -> Matcher:
    predictor = FlatPredictor(one_room(), lies={FALSE: LIE})
    keyframes = KeyframeStore(predictor)
    keyframes.add([*FIRST, *SECOND])
    return Matcher(predictor, keyframes, MatchingConfig(closure_reach=reach))


def verified(pair: tuple[int, int], *, reach: int = 10) -> bool:
    asked = matcher(reach=reach)
    found = asked.match(asked.keyframes.features([pair[0]]), [pair[1]])
    assert found.reachability[0] > 0.8
    return bool(loop_closures.verified(pair[0], found, asked, np.array([True])).reachability[0] > 0.8)


def test_an_edge_between_two_passes_of_one_place_is_proven() -> None:
    assert verified(TRUE)


def test_an_edge_between_places_that_only_look_alike_is_not() -> None:
    assert not verified(FALSE)


def test_without_closures_it_is_believed() -> None:
    assert verified(FALSE, reach=0)


def test_a_neighbour_in_time_needs_no_proof() -> None:
    predictor = FlatPredictor(one_room(), lies={(2, 3): LIE})
    keyframes = KeyframeStore(predictor)
    keyframes.add(FIRST)
    asked = Matcher(predictor, keyframes, MatchingConfig())
    found = asked.match(keyframes.features([2]), [3])
    assert loop_closures.verified(2, found, asked, np.array([True])).reachability[0] == found.reachability[0]


def is_proven_against_the_others(tilts: tuple[Tilt, Tilt] | None) -> bool:
    """Tell whether a match is proven that no other images confirm, where those of the second pass have other tilts."""
    lies = {(here.step, there.step): WRONG for here in FIRST for there in SECOND if (here.step, there.step) != TRUE}
    predictor = FlatPredictor(one_room(), lies=lies | {(there, here): -WRONG for here, there in lies})
    keyframes = KeyframeStore(predictor)
    if tilts is None:
        keyframes.add([*FIRST, *SECOND])
    else:
        level, other = tilts
        keyframes.add([replace(seen, tilt=level) for seen in FIRST])
        keyframes.add([replace(seen, tilt=level if seen.step == TRUE[1] else other) for seen in SECOND])
    asked = Matcher(predictor, keyframes, MatchingConfig(closure_reach=10))
    found = asked.match(keyframes.features([TRUE[0]]), [TRUE[1]])
    return bool(loop_closures.verified(TRUE[0], found, asked, np.array([True])).reachability[0] > 0.8)


def test_a_camera_that_was_tilted_aside_says_nothing_against_a_match() -> None:
    level = Tilt(0.0, 0.0)
    assert not is_proven_against_the_others(None)
    assert not is_proven_against_the_others((level, level))
    assert is_proven_against_the_others((level, Tilt(1.0, 0.0)))
    assert is_proven_against_the_others((level, Tilt(0.0, -1.0)))


def test_where_odometry_jumps_a_stretch_ends() -> None:
    keyframes = KeyframeStore(FlatPredictor(one_room()))
    keyframes.add([*FIRST[:3], *(replace(seen, odometry=seen.odometry + 9.0) for seen in SECOND[:3])])
    assert keyframes.temporal_window(1, 10) == (0, 2)
    assert keyframes.temporal_window(101, 10) == (100, 102)
    assert ROBUST.matching.closure_reach > 0


APART_M = 8.0
ROOM = [(1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0), (1.0, 1.0)]
OTHER_ROOM = [(x + APART_M, y) for x, y in ROOM]
LOOSE = replace(ROBUST, building=replace(ROBUST.building, odometry_drift=0.3))
"""Odometry that is trusted so little that only the closures can tell the rooms apart."""


class AliasedPredictor(FlatPredictor):
    """Takes a place in the one room for the same place in the other, and knows no corridor."""

    def encode(self, observations: Sequence[Observation]) -> Features:
        features = super().encode(observations)
        beyond = np.asarray(features[:, 0], np.float64) > APART_M - 1
        features[:, 0] -= np.where(beyond, APART_M, 0.0)
        return features


@cache
def drive() -> tuple[Observation, ...]:
    """Return a drive round both rooms, twice each, whose odometry turns a little too far."""
    seen = list(tour([*ROOM, *OTHER_ROOM, *ROOM, *OTHER_ROOM[:2]], spins=False))
    truth = np.array([each.odometry for each in seen])
    steps = relative(truth[:-1], truth[1:])
    steps += np.hypot(steps[:, :1], steps[:, 1:2]) * np.array([0.0, 0.0, 0.01])
    odometry = [truth[0]]
    for step in steps:
        odometry.append(compose(odometry[-1], step))
    return tuple(replace(each, odometry=pose) for each, pose in zip(seen, odometry, strict=True))


def built(method: Method) -> tuple[TopologicalGraph, KeyframeStore]:
    predictor = AliasedPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    deltas = build(drive(), keyframes, predictor, method, np.random.default_rng(0))
    return TopologicalGraph(deltas), keyframes


def false_edges(graph: TopologicalGraph) -> int:
    """Count the edges from one room to the other."""
    x_m = {frame: pose[0] for frame, pose in true_poses().items()}
    return sum(abs(x_m[source] - x_m[target]) > APART_M / 2 for source, target in graph.edges)


def true_poses() -> dict[FrameId, Pose]:
    return {seen.step: seen.exact_pose for seen in drive() if seen.exact_pose is not None}


def worst_error_m(images: Iterable[Observation]) -> float:
    truth = true_poses()
    return max(float(np.hypot(*(seen.odometry - truth[seen.step])[:2])) for seen in images)


def test_rooms_that_look_alike_are_told_apart_by_what_the_drive_passes_again() -> None:
    without, _ = built(replace(LOOSE, building=replace(LOOSE.building, close_loops=False)))
    graph, keyframes = built(LOOSE)
    assert false_edges(without) > 0
    assert false_edges(graph) == 0
    corrected = [keyframes.observation(frame) for frame in keyframes.frames]
    assert worst_error_m(corrected) < 0.6 < worst_error_m(drive())


def test_a_drive_that_passes_nothing_again_keeps_its_odometry() -> None:
    images = list(tour([(0.7, 0.7), (4.2, 0.7)], spins=False))
    predictor = FlatPredictor(one_room())
    keyframes = KeyframeStore(predictor)
    build(images, keyframes, predictor, ROBUST, np.random.default_rng(0))
    kept = {seen.step: seen.odometry for seen in images}
    assert all(np.array_equal(keyframes.observation(frame).odometry, kept[frame]) for frame in keyframes.frames)


def test_a_map_names_the_rooms_that_look_alike(tmp_path: Path) -> None:
    system = system_entry(DEFAULT_SYSTEM).factory(LOOSE)
    build_map(drive(), predictor=AliasedPredictor(one_room()), system=system).save(tmp_path / "map.rrd")
    told = read_info(tmp_path / "map.rrd").unsure
    assert told is not None
    x_m = {frame: pose[0] for frame, pose in true_poses().items()}
    assert all(abs(x_m[one] - x_m[other]) > APART_M / 2 for one, other, _ in told.look_alikes)
    assert "{:,} and {:,}".format(*told.look_alikes[0]) in str(told)
    assert 0 < told.unconfirmed < 1
    damaged = {"unsure": {"unconfirmed": 0.5, "longest": [0, 9], "look_alikes": [[1, 2], [3, -4, 5], "row", [7, 8, 9]]}}
    assert UnsurePlaces.recorded(damaged) == UnsurePlaces(0.5, (0, 9), ((7, 8, 9),))
