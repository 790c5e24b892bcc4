"""Belief updates after driving an edge: Eq. 3 for its existence and Eq. 4 for its length, as pure functions.

Owns the two Bayes filters; the caller decides about pruning.
"""

from ltvn_core.config import BeliefConfig
from ltvn_core.graph.deltas import Belief


def initial_belief(reachability: float, distance: float, config: BeliefConfig) -> Belief:
    """Return the belief of a new edge: p0 = r capped, mu0 = d(w), sigma0^2 = sigma^2."""
    return Belief(min(float(reachability), config.p_cap), float(distance), config.sigma2)


def update_existence(p: float, config: BeliefConfig, *, succeeded: bool, weight: float = 1.0) -> float:
    """Return p after one attempt, Eq. 3.

    p' = p(s|r) p / (p(s|r) p + p(s|not r) (1 - p)), with 1 - p(s|.) in place of p(s|.) after a failure. The cap keeps p
    below 1 after many successes, so that later failures can still prune the edge. `weight` is the share of a full
    attempt that this one counts for (ours).
    """
    if_there = (config.p_success_if_reachable if succeeded else 1 - config.p_success_if_reachable) ** weight
    if_not = (config.p_success_if_not if succeeded else 1 - config.p_success_if_not) ** weight
    evidence = if_there * p + if_not * (1 - p)
    return min(if_there * p / evidence, config.p_cap) if evidence > 0 else p


def update_length(belief: Belief, measured: float, config: BeliefConfig) -> tuple[float, float]:
    """Return (mu, sigma2) after d was measured once more, Eq. 4.

    mu' = (sigma^2 mu + sigma_t^2 d) / (sigma_t^2 + sigma^2) and 1 / sigma'^2 = 1 / sigma_t^2 + 1 / sigma^2. Beginning
    with sigma_0^2 = sigma^2 this is the running mean of all n measurements with variance sigma^2 / n.
    """
    total = belief.sigma2 + config.sigma2
    mu = (config.sigma2 * belief.mu + belief.sigma2 * measured) / total
    return mu, belief.sigma2 * config.sigma2 / total


def update_belief(
    belief: Belief, measured: float, config: BeliefConfig, *, succeeded: bool, weight: float = 1.0
) -> Belief:
    """Return the belief after an attempt: Eq. 3 always, Eq. 4 only after a success."""
    p = update_existence(belief.p, config, succeeded=succeeded, weight=weight)
    mu, sigma2 = update_length(belief, measured, config) if succeeded else (belief.mu, belief.sigma2)
    return Belief(p, mu, sigma2)
