"""Figures say what was found and how sure it is."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.evaluation.confidence_intervals import Estimate
from ltvn_core.evaluation.metrics import (
    EvaluationMetrics,
    RecognitionShares,
    compare_methods,
    compute_metrics,
    count_failures,
    recognition_of,
)
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.results import TestedMap
from tests.core.evaluation.fake_trials import random_trials, trial

OUTCOMES = st.lists(st.lists(st.booleans(), min_size=1, max_size=12), min_size=1, max_size=4)
"""Of the episodes of each trial."""


def trials_of(outcomes: list[list[bool]]) -> list[TestedMap]:
    return [trial(reached, scene=f"tune-{k % 2}", seed=k) for k, reached in enumerate(outcomes)]


def width(estimate: Estimate) -> float:
    return estimate.high - estimate.low


def estimates_of(found: EvaluationMetrics) -> list[Estimate]:
    return [
        *(found.success_rate, found.spl, found.collisions_per_episode),
        *(found.steps_per_episode, found.time_s, found.path_m),
    ]


@settings(max_examples=20, deadline=None)
@given(OUTCOMES)
def test_every_interval_contains_its_mean(outcomes: list[list[bool]]) -> None:
    for estimate in estimates_of(compute_metrics(trials_of(outcomes))):
        assert estimate.low <= estimate.mean <= estimate.high


@settings(max_examples=20, deadline=None)
@given(OUTCOMES, st.randoms())
def test_the_order_of_trials_and_episodes_changes_nothing(outcomes: list[list[bool]], random: Random) -> None:
    trials = trials_of(outcomes)
    shuffled = [replace(each, episodes=tuple(random.sample(each.episodes, len(each.episodes)))) for each in trials]
    random.shuffle(shuffled)
    assert compute_metrics(shuffled) == compute_metrics(trials)


@settings(max_examples=20, deadline=None)
@given(OUTCOMES)
def test_success_and_the_causes_of_failure_add_up(outcomes: list[list[bool]]) -> None:
    trials = trials_of(outcomes)
    found = compute_metrics(trials)
    assert found.episodes == sum(map(len, outcomes)) == sum(found.failures.values()) + sum(map(sum, outcomes))
    assert found.success_rate.mean == pytest.approx(np.mean([np.mean(each) for each in outcomes]))
    assert found.spl.mean == pytest.approx(0.8 * found.success_rate.mean)
    assert found.time_s.mean == pytest.approx(found.steps_per_episode.mean / 10)
    assert list(found.failures) == [cause.value for cause in FailureCause] == list(count_failures(trials))


def test_more_episodes_are_surer() -> None:
    few, many = (compute_metrics(random_trials([0.7], episodes=count)).success_rate for count in (40, 400))
    assert width(many) < width(few) / 2


def test_more_seeds_are_surer() -> None:
    few, many = (compute_metrics(random_trials([0.5, 0.9] * times)).success_rate for times in (1, 6))
    assert width(many) < width(few)


def test_seeds_that_scatter_are_less_sure_than_seeds_that_agree() -> None:
    alike, apart = (
        compute_metrics(random_trials(rates, episodes=300)).success_rate for rates in ([0.7] * 3, [0.5, 0.7, 0.9])
    )
    assert width(apart) > 2 * width(alike)


def test_scenes_that_differ_are_no_reason_for_doubt() -> None:
    easy, hard = (random_trials([rate] * 3, scenes=[name], episodes=300) for name, rate in (("a", 0.95), ("b", 0.4)))
    assert width(compute_metrics(easy + hard).success_rate) < 0.1


@pytest.mark.parametrize("reached", [True, False])
def test_no_exception_at_all_is_no_certainty(reached: bool) -> None:
    success = compute_metrics([trial([reached] * 20)]).success_rate
    assert success.mean == reached
    assert width(success) == pytest.approx(0.16, abs=0.02)


def test_maps_are_averaged_over_trials() -> None:
    found = compute_metrics([trial([True], seed=0), trial([True], seed=3)])
    assert (found.nodes, found.edges, found.spurious_edges) == (101.5, 400, 4)
    assert found.spurious_share == 0.01


@pytest.mark.parametrize("trials", [[], [trial([])]], ids=["no trial", "no episode"])
def test_nothing_has_no_metrics(trials: list[TestedMap]) -> None:
    with pytest.raises(ValueError, match="at least one"):
        compute_metrics(trials)
    with pytest.raises(ValueError, match="at least one"):
        compare_methods(random_trials([0.5]), trials)


def test_a_method_does_not_differ_from_itself() -> None:
    trials = random_trials([0.6, 0.8])
    found = compare_methods(trials, trials[::-1])
    assert found.paired
    assert tuple(found.success_rate) == (0, 0, 0)


def test_the_difference_of_two_methods_is_that_of_their_means() -> None:
    ours, theirs = random_trials([0.8, 0.9]), random_trials([0.5, 0.4], method="sptm")
    found, means = (
        compare_methods(ours, theirs),
        [compute_metrics(trials).success_rate.mean for trials in (ours, theirs)],
    )
    assert found.success_rate.mean == pytest.approx(means[0] - means[1])
    assert 0 < found.success_rate.low < found.success_rate.mean < found.success_rate.high
    assert compare_methods(theirs, ours).success_rate.mean == pytest.approx(-found.success_rate.mean)


def test_pairs_are_surer_than_hard_negatives() -> None:
    ours = random_trials([0.5, 0.9])
    worse = [replace(each, episodes=_with_one_more_failure(each)) for each in ours]
    strangers = [replace(each, columns=replace(each.columns, seed=each.columns.seed + 10)) for each in worse]
    paired, unpaired = compare_methods(ours, worse), compare_methods(ours, strangers)
    assert (paired.paired, unpaired.paired) == (True, False)
    assert paired.success_rate.mean == pytest.approx(unpaired.success_rate.mean)
    assert width(paired.success_rate) < width(unpaired.success_rate) / 2


def _with_one_more_failure(good: TestedMap) -> tuple[QueryResult, ...]:
    first = next(k for k, each in enumerate(good.episodes) if each.reached)
    return tuple(replace(each, reached=each.reached and k != first) for k, each in enumerate(good.episodes))


def test_confusions_and_checkpoints_are_shares_of_what_was_counted() -> None:
    whole = trial([True, False])
    far, near = (
        replace(each, checkpoints=4, crossed=crossed, localised=10, mislocalised=wrong)
        for each, crossed, wrong in zip(whole.episodes, (4, 1), (0, 5), strict=True)
    )
    shares = recognition_of([replace(whole, episodes=(far, replace(near, outcome="arrived")))])

    assert shares == RecognitionShares(crossed=0.625, mislocalised=0.25, wrong_arrivals=0.5)


def test_results_from_before_confusions_were_counted_claim_none() -> None:
    assert recognition_of([trial([True, False])]) is None
