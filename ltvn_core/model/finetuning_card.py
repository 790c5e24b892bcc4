"""The card of fine-tuned weights: their parent, the drive they know, and their figures before and after.

Owns the card's fields. `ltvn_core.model.weights` writes it beside the weights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ltvn_core.model.finetuning import FineTuningPlan, Standing

PAIR_NAMES = ("auc", "position_median_m", "position_p90_m", "yaw_median_deg", "ece")
FAR_NAMES = ("far_pairs", "far_fpr_at_tpr60", "far_fpr_at_half", "near_tpr_at_half")


@dataclass(frozen=True)
class FineTuningCard:
    """All that is known of fine-tuned weights beyond what their parent's card says."""

    parent: str
    """Fingerprint of the weights that fine-tuning started from."""
    parent_card: Mapping[str, Any]
    """Their card."""
    recording: str
    """Name of the recording of the drive."""
    run: Mapping[str, Any]
    """What tells this run from others: the same run is not done twice."""
    command: str
    """What makes these weights again, up to the time that learning took elsewhere."""
    seed: int
    images: int
    """Images of the drive that were used,"""
    pieces: int
    """and the pieces between jumps of its odometry."""
    simulated_scenes: tuple[str, ...]
    """Scenes that were shown in between, so that nothing is unlearned."""
    validation_scenes: tuple[str, ...]
    """Scenes of the simulated figures and of the calibration."""
    plan: FineTuningPlan
    steps: int
    pairs_compared: int
    minutes: float
    before: Standing | None
    """None where nobody asked to judge."""
    after: Standing | None


def flat_figures(standing: Mapping[str, Any] | None) -> dict[str, float]:
    """Return by name the figures of a `Standing`, as a card holds it, that matter most; none for None."""
    if standing is None:
        return {}
    own = standing["own"]
    found = _named("own", own["pairs"], PAIR_NAMES) | _named("own", own["far"], FAR_NAMES)
    found |= _named("simulated", standing["simulated"], PAIR_NAMES)
    return found | _named("simulated", standing["simulated_drives"] or {}, FAR_NAMES)


def _named(where: str, figures: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    return {f"{where}_{name}": figures[name] for name in names if name in figures}
