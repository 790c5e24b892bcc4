"""Measurements of driving with a set of weights in simulation, the source of the constants of Eq. 3 and Eq. 4.

Part of the model card. `tools/measure_driving.py` makes the measurements.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.config import BeliefConfig, Likelihoods
from ltvn_core.errors import WeightsError
from ltvn_core.network.metrics import CalibrationBin, ErrorBin, SuccessRate
from ltvn_core.network.weights_file import matching_card

MIN_SIGMA_M = 0.01
"""Lower bound of sigma, because Eq. 4 divides by its square."""

DRIVING_SECTION = "driving"
"""Name of this section of a model card."""


@dataclass(frozen=True, slots=True)
class DrivingMeasurements:
    """Results of edges driven in simulation with the method's own controller, and metrics on the same drives."""

    command: str
    """Command that repeats the measurements."""
    scenes: tuple[str, ...]
    """Scenes used neither for training nor for the choice of weights."""
    images: int
    """Number of images of the mapping drive through each scene."""
    success_if_reachable: SuccessRate
    """p(s given r): how often the method reports success after driving an edge that exists."""
    success_if_not: SuccessRate
    """p(s given not r): how often the method reports success after driving an edge that does not exist."""
    arrival_if_reachable: SuccessRate
    """Share of attempts that truly ended within 0.72 m and 0.4 rad of the edge's end, for edges that exist."""
    arrival_if_not: SuccessRate
    """Share of attempts that truly ended within 0.72 m and 0.4 rad of the edge's end, for edges that do not exist."""
    connected_if_not: int
    """Number of driven edges that do not exist, but that the method would add to a map. The other driven edges that do
    not exist are those with the next highest r."""
    not_begun: int
    """Number of edges not driven because the robot did not localise at their source."""
    distance_sigma: float
    """Standard deviation of d(predicted) - d(true) over the reachable pairs that become edges: sigma of Eq. 4."""
    distance_sigma_all: float
    """Standard deviation of d(predicted) - d(true) over all reachable pairs, whatever their r."""
    calibration: tuple[CalibrationBin, ...]
    """Calibration of r on all ordered pairs of the drives."""
    error_by_distance: tuple[ErrorBin, ...]
    """Position error of reachable pairs against their distance in metres."""
    error_by_overlap: tuple[ErrorBin, ...]
    """Position error of reachable pairs against the share of the target's points that the source sees."""


def likelihoods(measured: DrivingMeasurements) -> Likelihoods:
    """Return the constants of Eq. 3 and Eq. 4.

    Both probabilities are Laplace estimates, so p(s given r) is never 1 and p(s given not r) never 0: a single attempt
    can never decide that an edge exists or not. If no false edge was driven, p(s given not r) is the default value.
    Raises WeightsError if success is not more frequent on edges that exist, because Eq. 3 would then prune them.
    """
    there = measured.success_if_reachable.shrunk
    not_there = measured.success_if_not.shrunk if measured.success_if_not.trials else BeliefConfig().p_success_if_not
    if there <= not_there:
        raise WeightsError(
            f"Edges that exist were driven successfully less often ({there:.2f}) than edges that do not "
            f"({not_there:.2f}), so these weights cannot maintain a map; train them longer, or measure more attempts."
        )
    return Likelihoods(there, not_there, max(measured.distance_sigma, MIN_SIGMA_M) ** 2)


def measured_likelihoods(weights: Path) -> Likelihoods | None:
    """Return the constants from the card beside weights; None if they were not measured. Raises WeightsError."""
    measured = read_driving(matching_card(weights))
    return None if measured is None else likelihoods(measured)


def read_driving(card: Mapping[str, Any]) -> DrivingMeasurements | None:
    """Return the driving measurements of a card, or of its parent's card if it has none; None if neither has any.

    Raises WeightsError if they are damaged.
    """
    section = card.get(DRIVING_SECTION)
    if section is None:
        parent = card.get("parent_card")
        return read_driving(parent) if isinstance(parent, Mapping) else None
    try:
        measured = cattrs.structure(section, DrivingMeasurements)
        for rate in (measured.success_if_reachable, measured.success_if_not):
            SuccessRate.of(rate.successes, rate.trials)
        if not 0 <= measured.distance_sigma < float("inf"):
            raise ValueError(f"the standard deviation of d must be 0 or more, got {measured.distance_sigma}")
    except (cattrs.BaseValidationError, TypeError, ValueError) as error:
        raise WeightsError(
            f"The part {DRIVING_SECTION!r} of the weights' card is damaged ({error}); copy the card anew, or remove "
            "this part of it to use the default constants."
        ) from error
    return measured
