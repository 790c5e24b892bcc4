"""How sure a pose is after all evidence: logistic regressions that `tools/fit_geometric.py` fitted.

Owns the weights, one set for pairs with depth in both images, in one, and in none, and the file they are in.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

CALIBRATION_FILE = Path(__file__).with_name("geometric_calibration.json")
"""The fitted weights, and what they were fitted on."""

BOTH_DEPTHS, ONE_DEPTH, NO_DEPTH = "both", "one", "none"
"""How many of the two images have depth."""


@dataclass(frozen=True, slots=True)
class Logistic:
    """Weights of the evidence by its names."""

    weights: Mapping[str, float]
    bias: float

    def probability(self, evidence: Mapping[str, float]) -> float:
        """Return how likely a pose is right, in [0, 1]."""
        total = self.bias + sum(weight * evidence[name] for name, weight in self.weights.items())
        return float(1 / (1 + np.exp(-np.clip(total, -30, 30))))


@lru_cache(maxsize=1)
def shipped_calibration() -> Mapping[str, Logistic]:
    """Return the weights that come with the package, by how many of the two images have depth."""
    fitted = json.loads(CALIBRATION_FILE.read_text())
    return {name: Logistic(part["weights"], part["bias"]) for name, part in fitted["logistics"].items()}
