"""Two stretches of driving meet where they are said to meet, or the match is not believed."""

from dataclasses import replace

import numpy as np

from ltvn_core.config import ROBUST, Matching
from ltvn_core.graph.closures import Closures, Standard, Stretch
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.views import Views
from ltvn_core.nav.trail import Trail
from tests.core.world import FlatPredictor, look_at, one_room

FIRST = [look_at(np.array([0.5 + 0.3 * k, 1.0, 0.0]), k) for k in range(12)]
SECOND = [look_at(np.array([0.5 + 0.3 * k, 1.2, 0.0]), 100 + k) for k in range(12)]
"""Two passes through a room, side by side."""
TRUE, FALSE = (2, 102), (2, 109)
LOOKS = Standard(reach=30, share=0.2, fewest=3)
LIE = np.array([0.1, 0.0, 0.0])


def matcher(*, reach: int = 10) -> Matcher:
    predictor = FlatPredictor(one_room(), lies={FALSE: LIE})
    views = Views(predictor)
    views.add([*FIRST, *SECOND])
    return Matcher(predictor, views, Matching(closure_reach=reach))


def proven(pair: tuple[int, int], *, reach: int = 10) -> bool:
    asked = matcher(reach=reach)
    found = asked.match(asked.views.features([pair[0]]), [pair[1]])
    assert found.reachability[0] > 0.8
    return bool(Closures(asked).proven(pair[0], found, np.array([True])).reachability[0] > 0.8)


def test_an_edge_between_two_passes_of_one_place_is_proven() -> None:
    assert proven(TRUE)


def test_an_edge_between_places_that_only_look_alike_is_not() -> None:
    assert not proven(FALSE)


def test_without_closures_it_is_believed() -> None:
    assert proven(FALSE, reach=0)


def test_a_neighbour_in_time_needs_no_proof() -> None:
    predictor = FlatPredictor(one_room(), lies={(2, 3): LIE})
    views = Views(predictor)
    views.add(FIRST)
    asked = Matcher(predictor, views, Matching())
    found = asked.match(views.features([2]), [3])
    assert Closures(asked).proven(2, found, np.array([True])).reachability[0] == found.reachability[0]


def driven(count: int) -> Stretch | None:
    """Return what a robot saw on its way along the first pass to frame `count`, by its own odometry."""
    trail, predictor = Trail(), FlatPredictor(one_room())
    for seen in FIRST[:count]:
        trail.saw(seen.odometry, predictor.encode([seen]))
    return trail.seen_from(FIRST[count].odometry)


def test_what_was_seen_on_the_way_tells_the_place_from_one_that_looks_alike() -> None:
    trail = driven(8)
    assert trail is not None
    there = np.array([0.0, 0.2, 0.0])
    assert Closures(matcher()).fits(trail, 108, there, LOOKS)
    assert not Closures(matcher()).fits(trail, 103, there, LOOKS)


def test_at_the_beginning_of_a_way_nothing_can_be_said() -> None:
    assert driven(0) is None
    trail = driven(1)
    assert trail is not None
    assert Closures(matcher()).fits(trail, 103, np.zeros(3), LOOKS)


def test_a_trail_keeps_only_looks_from_different_places_and_forgets_when_told() -> None:
    trail, features = Trail(), np.zeros((1, 4))
    for x in (0.0, 0.01, 0.5, 0.51, 1.0):
        trail.saw(np.array([x, 0.0, 0.0]), features)
    stretch = trail.seen_from(np.array([1.0, 0.0, 0.0]))
    assert stretch is not None
    assert np.allclose(stretch.poses[:, 0], [-1.0, -0.5])
    trail.forget()
    assert trail.seen_from(np.zeros(3)) is None


def test_where_odometry_jumps_a_stretch_ends() -> None:
    views = Views(FlatPredictor(one_room()))
    views.add([*FIRST[:3], *(replace(seen, odometry=seen.odometry + 9.0) for seen in SECOND[:3])])
    assert views.around(1, 10) == (0, 2)
    assert views.around(101, 10) == (100, 102)
    assert ROBUST.matching.closure_reach > 0
