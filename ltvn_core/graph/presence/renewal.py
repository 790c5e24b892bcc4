"""Where a thing that goes and comes is after a while: an alternating renewal process on a grid of time.

Owns the integral equations. Knows nothing of observations.
"""

import numpy as np

from ltvn_core.graph.presence.durations import FloatArray


def return_probabilities(own: FloatArray, other: FloatArray) -> FloatArray:
    """Return (I, N) the probability of being back in a state at times 0, 1, ... I-1 after it was left.

    With A the probability of being in the state after entering it, and B after leaving it, f the densities of the
    lengths of stays and S their survival:

        A(t) = S_own(t) + integral of f_own(u) B(t - u) du,    B(t) = integral of f_other(u) A(t - u) du.

    Stays that begin and end within one step of the grid are taken in by solving both equations of a step together.

    Args:
        own: (2 I - 1, N) survival of stays in the state, at every half step from 0 on.
        other: (2 I - 1, N) survival of stays away from it.
    """
    own_steps, other_steps = _StepEnds(own), _StepEnds(other)
    count = len(own_steps.survival)
    in_state = np.ones_like(own_steps.survival)
    back = np.zeros_like(own_steps.survival)
    within = 1 - own_steps.first * other_steps.first
    for i in range(1, count):
        stayed = own_steps.survival[i] + own_steps.convolve(back, i)
        returned = other_steps.convolve(in_state, i) + other_steps.last[i]
        in_state[i] = (stayed + own_steps.first * returned) / np.maximum(within, 1e-12)
        back[i] = returned + other_steps.first * in_state[i]
    return np.clip(back, 0.0, 1.0)


class _StepEnds:
    """How much of a stay ends within each step of the grid."""

    def __init__(self, half_steps: FloatArray) -> None:
        """Take (2 I - 1, N) survival at every half step."""
        self.survival = half_steps[::2]
        """(I, N) at whole steps."""
        middles = half_steps[1::2]
        self.first = 1 - middles[0] if len(middles) else np.zeros_like(half_steps[0])
        """(N,) stays that end within half a step."""
        self._around = middles[:-1] - middles[1:]
        """(I - 2, N) stays that end within half a step of 1, 2, ..."""
        self.last = np.concatenate([np.zeros_like(half_steps[:1]), middles - self.survival[1:]])
        """(I, N) stays that end within the half step before 0, 1, ..."""

    def convolve(self, after: FloatArray, i: int) -> FloatArray:
        """Return (N,) the sum over lags 1 to i - 1 of what ends there times what follows."""
        return np.einsum("jn,jn->n", self._around[: i - 1], after[i - 1 : 0 : -1])
