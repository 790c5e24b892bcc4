"""Eq. 3 moves the right way and never past the cap; Eq. 4 is a running mean."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ltvn_core.config import BeliefConfig
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.operators import initial_belief, update_belief, update_existence, update_length

chances = st.floats(0.01, 0.95)
configs = st.builds(
    lambda if_there, if_not: BeliefConfig(p_success_if_reachable=if_there, p_success_if_not=if_not),
    st.floats(0.5, 0.99),
    st.floats(0.01, 0.45),
)


@given(chances, configs)
def test_a_success_never_lowers_p_and_a_failure_never_raises_it(p: float, config: BeliefConfig) -> None:
    assert update_existence(p, config, succeeded=True) >= min(p, config.p_cap) - 1e-12
    assert update_existence(p, config, succeeded=False) <= p + 1e-12


@given(chances, chances, configs, st.booleans())
def test_a_more_believed_edge_stays_more_believed(p: float, q: float, config: BeliefConfig, succeeded: bool) -> None:
    assume(p <= q)
    assert update_existence(p, config, succeeded=succeeded) <= update_existence(q, config, succeeded=succeeded) + 1e-12


@given(chances, st.lists(st.booleans(), max_size=30), configs)
def test_p_stays_between_zero_and_the_cap(p: float, history: list[bool], config: BeliefConfig) -> None:
    for succeeded in history:
        p = update_existence(p, config, succeeded=succeeded)
        assert 0 <= p <= config.p_cap


@given(chances, configs, st.lists(st.booleans(), min_size=2, max_size=6))
def test_below_the_cap_the_order_of_the_evidence_does_not_matter(
    p: float, config: BeliefConfig, history: list[bool]
) -> None:
    free = replace(config, p_cap=1.0)

    def after(attempts: list[bool]) -> float:
        q = p
        for succeeded in attempts:
            q = update_existence(q, free, succeeded=succeeded)
        return q

    assert after(history) == pytest.approx(after(sorted(history)), abs=1e-9)


def test_bayes_by_hand() -> None:
    config = BeliefConfig(p_success_if_reachable=0.8, p_success_if_not=0.2, p_cap=1.0)
    assert update_existence(0.5, config, succeeded=True) == pytest.approx(0.8)
    assert update_existence(0.5, config, succeeded=False) == pytest.approx(0.2)


def test_an_impossible_observation_leaves_the_belief_alone() -> None:
    config = BeliefConfig(p_success_if_reachable=1.0, p_success_if_not=1.0)
    assert update_existence(0.7, config, succeeded=False) == 0.7


@given(st.floats(0, 3), st.lists(st.floats(0, 3), min_size=1, max_size=20))
def test_the_length_is_the_running_mean_of_all_measurements(first: float, others: list[float]) -> None:
    config = BeliefConfig()
    belief = initial_belief(0.9, first, config)
    for measured in others:
        belief = Belief(belief.p, *update_length(belief, measured, config))
    assert belief.mu == pytest.approx(np.mean([first, *others]), abs=1e-9)
    assert belief.sigma2 == pytest.approx(config.sigma2 / (len(others) + 1))


def test_a_failure_teaches_nothing_about_the_length() -> None:
    before = Belief(0.8, 1.0, 0.02)
    after = update_belief(before, 3.0, BeliefConfig(), succeeded=False)
    assert (after.mu, after.sigma2) == (before.mu, before.sigma2)
    assert after.p < before.p


def test_a_new_edge_is_believed_as_far_as_the_network_does_but_not_past_the_cap() -> None:
    assert initial_belief(0.7, 1.2, BeliefConfig()).p == 0.7
    assert initial_belief(0.999, 1.2, BeliefConfig()).p == BeliefConfig().p_cap
