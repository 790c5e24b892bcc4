"""The model card of fine-tuned weights: their parent, the drive, and metrics before and after.

`ltvn_core.network.weights_file` writes it beside the weights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ltvn_core.network.optimization.fine_tuning_loop import FineTuningMetrics, FineTuningPlan

PAIR_METRICS = ("auc", "position_median_m", "position_p90_m", "yaw_median_deg", "ece")
FAR_METRICS = ("far_pairs", "far_fpr_at_tpr60", "far_fpr_at_half", "near_tpr_at_half")


@dataclass(frozen=True)
class FineTuningCard:
    """The model card of fine-tuned weights; it contains the card of their parent."""

    parent: str
    """Fingerprint of the weights that fine-tuning started from."""
    parent_card: Mapping[str, Any]
    """Their card."""
    recording: str
    """Name of the recording of the drive."""
    run: Mapping[str, Any]
    """The settings that identify this run; an equal run is not repeated."""
    command: str | None
    """What makes these weights again, up to the time that learning took elsewhere; None where no command line does."""
    seed: int
    images: int
    """Images of the drive that were used,"""
    pieces: int
    """and the pieces between jumps of its odometry."""
    simulated_scenes: tuple[str, ...]
    """Simulated scenes in the batches, against forgetting."""
    validation_scenes: tuple[str, ...]
    """Scenes of the simulated metrics and of the calibration."""
    plan: FineTuningPlan
    steps: int
    pairs_compared: int
    minutes: float
    before: FineTuningMetrics | None
    """None if the run was not evaluated."""
    after: FineTuningMetrics | None


def flat_metrics(metrics: Mapping[str, Any] | None) -> dict[str, float]:
    """Return the most important metrics of a `FineTuningMetrics` in a card, by name; empty for None."""
    if metrics is None:
        return {}
    own = metrics["own"]
    found = _named("own", own["pairs"], PAIR_METRICS) | _named("own", own["far"], FAR_METRICS)
    found |= _named("simulated", metrics["simulated"], PAIR_METRICS)
    return found | _named("simulated", metrics["simulated_drives"] or {}, FAR_METRICS)


def _named(where: str, figures: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    return {f"{where}_{name}": figures[name] for name in names if name in figures}
