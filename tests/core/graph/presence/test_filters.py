"""Filters of presence against Bayes' rule computed by brute force, and against simulated processes."""

import numpy as np
import pytest

from ltvn_core.graph.presence.presence_filter import (
    PERSISTENT,
    DurationMixture,
    PersistentFilter,
    PresenceFilter,
    PresenceObservation,
    SightErrors,
    follow_histories,
    return_probabilities,
)

NEVER = DurationMixture.exponential([1e12], [1.0])
ERRORS = SightErrors(miss=0.2, false_alarm=0.1)


def presence_probability(presence_filter: PresenceFilter, seen: list[PresenceObservation], now_s: float) -> float:
    known = [each for each in seen if each.stamp_s <= now_s]
    return float(follow_histories(presence_filter, [known]).probability(now_s)[0])


def mixture(rng: np.random.Generator) -> DurationMixture:
    return DurationMixture(
        scales_s=rng.uniform(20, 200, 3),
        shapes=rng.uniform(0.7, 5, 3),
        weights=rng.dirichlet(np.ones(3)),
    )


def looks(rng: np.random.Generator, gone_at: float = 120.0) -> list[PresenceObservation]:
    stamps = np.cumsum(rng.exponential(8.0, 25))
    wrong = rng.random(25) < 0.15
    return [PresenceObservation(bool((at < gone_at) ^ flip), float(at)) for at, flip in zip(stamps, wrong, strict=True)]


def by_brute_force(seen: list[PresenceObservation], stays: DurationMixture, errors: SightErrors, now: float) -> float:
    """Weigh every length of the stay that begins with the first look, on a grid of 0.02 s."""
    length = np.arange(0.01, 3000, 0.02)
    edges = np.append(length - 0.01, 3000 - 0.01)
    lasting = (stays.weights * np.exp(-((edges[:, None] / stays.scales_s) ** stays.shapes))).sum(axis=1)
    posterior = np.log(np.maximum(lasting[:-1] - lasting[1:], 1e-300))
    for present, stamp in seen:
        there = length > stamp - seen[0].stamp_s
        found = np.where(there, 1 - errors.miss, errors.false_alarm)
        posterior += np.log(found if present else 1 - found)
    weights = np.exp(posterior - posterior.max())
    return float(weights[length > now - seen[0].stamp_s].sum() / weights.sum())


@pytest.mark.parametrize("seed", range(6))
def test_a_stay_is_judged_as_bayes_rule_over_all_its_lengths_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stays, seen = mixture(rng), looks(rng)
    alone = PersistentFilter(present=stays, absent=NEVER, errors=ERRORS, present_at_first=1 - 1e-12, switch_below=0.0)
    for count in (1, 5, 12, 25):
        now = seen[count - 1].stamp_s + rng.uniform(0, 30)
        expected = by_brute_force(seen[:count], stays, ERRORS, now)
        assert presence_probability(alone, seen[:count], now) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("seed", range(4))
def test_absence_is_judged_as_presence_is_with_everything_reversed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stays, aways, seen = mixture(rng), mixture(rng), looks(rng)
    as_it_is = PersistentFilter(present=stays, absent=aways, errors=ERRORS)
    flipped = SightErrors(miss=ERRORS.false_alarm, false_alarm=ERRORS.miss)
    reversed_filter = PersistentFilter(present=aways, absent=stays, errors=flipped)
    away_first = [PresenceObservation(present=False, stamp_s=-1000.0)] * 6
    there_first = [PresenceObservation(present=True, stamp_s=-1000.0)] * 6
    mirrored = [PresenceObservation(not each.present, each.stamp_s) for each in seen]
    one = presence_probability(as_it_is, [*away_first, *seen], 300.0)
    other = presence_probability(reversed_filter, [*there_first, *mirrored], 300.0)
    assert one == pytest.approx(1 - other, abs=0.02)


def test_the_future_of_what_goes_and_comes_is_that_of_a_simulated_process() -> None:
    rng = np.random.default_rng(5)
    steps, span_s = 32, 700.0
    half_steps = np.linspace(0, span_s, 2 * steps + 1)[:, None]
    own, other = (200.0, 4.0), (60.0, 1.5)
    survival = [np.exp(-((half_steps / scale) ** shape)) for scale, shape in (own, other)]
    told = return_probabilities(*survival)[:, 0]
    runs = 20_000
    ends = np.cumsum([(other, own)[k % 2][0] * rng.weibull((other, own)[k % 2][1], runs) for k in range(60)], axis=0)
    for step in (1, 4, 9, 17, 32):
        at = span_s * step / steps
        back = ((ends < at).sum(axis=0) % 2 == 1).mean()
        assert told[step] == pytest.approx(back, abs=0.025)


def test_many_things_are_judged_as_each_alone() -> None:
    rng = np.random.default_rng(2)
    histories = [looks(rng, gone_at)[: rng.integers(0, 25)] for gone_at in (0, 40, 80, 200)]
    together = follow_histories(PERSISTENT, histories).probability(400.0)
    alone = [presence_probability(PERSISTENT, history, 400.0) for history in histories]
    assert together == pytest.approx(alone)
    assert np.all((together >= 0) & (together <= 1))


def test_what_was_seen_later_says_nothing_of_a_moment_before() -> None:
    seen = [PresenceObservation(present=False, stamp_s=100.0)]
    assert presence_probability(PERSISTENT, seen, 99.0) == pytest.approx(0.9)


def test_somebody_who_stood_in_the_way_is_soon_forgotten_and_a_closed_door_is_not() -> None:
    absent = PresenceObservation(present=False, stamp_s=0.0)
    again = PresenceObservation(present=False, stamp_s=600.0)
    assert presence_probability(PERSISTENT, [absent], 1.0) < 0.1
    assert presence_probability(PERSISTENT, [absent], 60.0) > 0.25
    assert presence_probability(PERSISTENT, [absent, again], 660.0) < 0.1
    assert presence_probability(PERSISTENT, [absent, again], 600.0 + 24 * 3600) > 0.5


def test_a_door_that_opened_again_is_believed_to_be_open() -> None:
    seen = [PresenceObservation(present=False, stamp_s=float(at)) for at in (0, 600)]
    seen.append(PresenceObservation(present=True, stamp_s=2000.0))
    assert presence_probability(PERSISTENT, seen, 2600.0) > 0.9


def test_a_mixture_that_does_not_sum_to_one_is_refused() -> None:
    with pytest.raises(ValueError, match="weights"):
        DurationMixture.exponential([10.0, 20.0], [0.5, 0.6])
