"""The filters of presence that the example brings are those they say they are, and maps are driven with them."""

import numpy as np
import pytest

import ltvn_core as ltvn
from examples.presence_plugin.presence_filters import (
    FORGETTING,
    FREMEN,
    ForgettingFilter,
    forgetting_system,
    fremen_system,
)
from ltvn_core.graph.presence.edge_presence import FilteredPresence
from ltvn_core.graph.presence.presence_filter import (
    DurationMixture,
    PersistentFilter,
    PresenceFilter,
    PresenceObservation,
    SightErrors,
    follow_histories,
)

ERRORS = SightErrors(miss=0.2, false_alarm=0.1)


def presence_probability(presence_filter: PresenceFilter, seen: list[PresenceObservation], now_s: float) -> float:
    known = [each for each in seen if each.stamp_s <= now_s]
    return float(follow_histories(presence_filter, [known]).probability(now_s)[0])


@pytest.mark.parametrize("seed", range(3))
def test_what_may_end_at_any_moment_is_judged_as_by_the_exact_filter_of_such_a_process(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stay_s, away_s = 300.0, 120.0
    persistent = PersistentFilter(
        present=DurationMixture.exponential([stay_s], [1.0]),
        absent=DurationMixture.exponential([away_s], [1.0]),
        errors=ERRORS,
        present_at_first=stay_s / (stay_s + away_s),
    )
    exact = ForgettingFilter(np.array(stay_s / (stay_s + away_s)), np.array(1 / (1 / stay_s + 1 / away_s)), ERRORS)
    changes = np.cumsum(rng.exponential(200, 30))
    stamps = np.cumsum(rng.exponential(10, 200))
    there = np.searchsorted(changes, stamps) % 2 == 0
    found = there ^ (rng.random(200) < np.where(there, ERRORS.miss, ERRORS.false_alarm))
    row, gaps = np.zeros(1, np.intp), []
    tracks = [each.follow(1) for each in (persistent, exact)]
    for k in range(200):
        for each in tracks:
            each.observe(row, found[k : k + 1], stamps[k : k + 1])
        if k % 10 == 0:
            nows = stamps[k] + np.array([0.0, 60.0, 400.0, 5000.0])
            gaps += [abs(tracks[0].probability(now) - tracks[1].probability(now)) for now in nows]
    assert np.mean(gaps) < 0.02


def test_fremen_foretells_what_happens_every_day() -> None:
    hours = np.arange(0, 6 * 24, 0.5)
    seen = [PresenceObservation(bool(8 <= hour % 24 < 20), float(hour * 3600)) for hour in hours]
    noon, midnight = (presence_probability(FREMEN, seen, (6 * 24 + hour) * 3600) for hour in (14, 26))
    assert noon > 0.8
    assert midnight < 0.2


def test_what_was_seen_is_forgotten() -> None:
    seen = [PresenceObservation(present=False, stamp_s=0.0)]
    assert presence_probability(FORGETTING, seen, 60.0) < 0.2
    assert presence_probability(FORGETTING, seen, 24 * 3600.0) == pytest.approx(0.9)


def test_the_systems_judge_edges_by_these_filters() -> None:
    for make, expected in ((forgetting_system, FORGETTING), (fremen_system, FREMEN)):
        presence = make(ltvn.ROBUST).presence
        assert isinstance(presence, FilteredPresence)
        assert presence.presence_filter is expected
