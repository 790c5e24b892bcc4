"""Two stretches of driving meet where they are said to meet, or the match is not believed."""

from dataclasses import replace

import numpy as np

from ltvn_core.config import ROBUST, MatchingConfig
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher
from ltvn_core.types import Tilt
from tests.core.flat_world import FlatPredictor, observation_at, one_room

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
    return bool(LoopClosureVerifier(asked).verified(pair[0], found, np.array([True])).reachability[0] > 0.8)


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
    assert LoopClosureVerifier(asked).verified(2, found, np.array([True])).reachability[0] == found.reachability[0]


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
    return bool(LoopClosureVerifier(asked).verified(TRUE[0], found, np.array([True])).reachability[0] > 0.8)


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
