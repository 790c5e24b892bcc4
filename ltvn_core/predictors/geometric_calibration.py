"""How sure a pose is after all evidence: logistic regressions, those that come with the package or a drive's own.

Owns the weights, one set for pairs with depth in both images, in one, and in none, and the file they are in.
`tools/fit_geometric.py` fitted what comes with the package; `geometric_adaptation` adapts it to a drive.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.errors import DriveError, WeightsError
from ltvn_core.importing.foreign_files import read_foreign
from ltvn_core.predictors.geometric_evidence import Evidence
from ltvn_core.predictors.geometric_pose import ROOM_DEPTH_M
from ltvn_core.structured_text import parse_json

CALIBRATION_FILE = Path(__file__).with_name("geometric_calibration.json")
"""The fitted weights, and what they were fitted on."""


NO_DEPTH, ONE_DEPTH, BOTH_DEPTHS = "none", "one", "both"
"""How many of the two images have depth."""
DEPTHS = (NO_DEPTH, ONE_DEPTH, BOTH_DEPTHS)

MAX_DEPTH_M = 100.0
_MOST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Logistic:
    """Weights of the evidence by its names."""

    weights: Mapping[str, float]
    bias: float

    def probability(self, evidence: Mapping[str, float]) -> float:
        """Return how likely a pose is right, in [0, 1]."""
        total = self.bias + sum(weight * evidence[name] for name, weight in self.weights.items())
        return float(1 / (1 + np.exp(-np.clip(total, -30, 30))))


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the evidence of a pair is worth."""

    logistics: Mapping[str, Logistic]
    """By how many of the two images have depth, see `DEPTHS`."""
    room_depth_m: float = ROOM_DEPTH_M
    """How far away things usually are: what distances are guessed by where no image has depth."""
    card: Mapping[str, Any] = field(default_factory=dict)
    """What it was fitted on, as JSON has it."""

    @property
    def fingerprint(self) -> str:
        """Name its numbers, in 12 hexadecimal digits."""
        numbers = {name: [dict(part.weights), part.bias] for name, part in self.logistics.items()}
        text = json.dumps([numbers, self.room_depth_m], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def text(self) -> str:
        """Write it as `read_calibration` reads it."""
        logistics = {name: {"weights": dict(part.weights), "bias": part.bias} for name, part in self.logistics.items()}
        held = {"logistics": logistics, "room_depth_m": self.room_depth_m, "card": dict(self.card)}
        return json.dumps(held, indent=1) + "\n"


@lru_cache(maxsize=1)
def shipped_calibration() -> Calibration:
    """Return the calibration that comes with the package."""
    return read_calibration(CALIBRATION_FILE)


def read_calibration(path: Path) -> Calibration:
    """Read a calibration. Raises WeightsError for a file that is missing, cut or something else."""
    try:
        held = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what="calibration"))
        logistics = {name: _logistic(held["logistics"][name]) for name in DEPTHS}
        depth = _finite(held.get("room_depth_m", ROOM_DEPTH_M))
        if not 0 < depth < MAX_DEPTH_M:
            raise ValueError(f"room_depth_m is {depth:g}")
        return Calibration(logistics, depth, dict(held.get("card", {})))
    except (DriveError, OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise WeightsError(
            f"{path}: no calibration of the geometric predictor ({reason}); `ltvn finetune DRIVE.rrd --predictor "
            "geometric --output NAME.json` writes one, and without --weights the one of the package is used."
        ) from error


def _logistic(part: Mapping[str, Any]) -> Logistic:
    weights = {str(name): _finite(weight) for name, weight in part["weights"].items()}
    if weights.keys() != set(Evidence._fields):
        raise ValueError(f"weights are of {', '.join(weights) or 'nothing'}, not of {', '.join(Evidence._fields)}")
    return Logistic(weights, _finite(part["bias"]))


def _finite(number: object) -> float:
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
        raise ValueError(f"{number!r:.40} is no number")
    return float(number)
