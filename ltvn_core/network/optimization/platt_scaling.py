"""Fits the two numbers that turn logits into honest probabilities (Platt scaling).

Owns the fit. The result lives in the network's `calibration` buffer.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit


def fit_platt(logits: NDArray[np.float64], positive: NDArray[np.bool_]) -> tuple[float, float]:
    """Return scale (> 0) and offset that minimise the cross-entropy of logits (N,) against truth (N,)."""
    if positive.all() or not positive.any():
        return 1.0, 0.0

    def cross_entropy(numbers: NDArray[np.float64]) -> float:
        scaled = np.exp(numbers[0]) * logits + numbers[1]
        return float((np.logaddexp(0, scaled) - positive * scaled).mean())

    found = minimize(cross_entropy, np.zeros(2), method="Nelder-Mead")
    return float(np.exp(found.x[0])), float(found.x[1])


def logit(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of the logistic function, kept finite."""
    clipped = np.clip(probability, expit(-30), expit(30))
    return np.log(clipped) - np.log1p(-clipped)
