"""What fine-tuning brought, in plain lines, and whether its weights should be offered."""

from ltvn_core.verbs.finetune import FineTunedWeights

FAR_FALSE_POSITIVE_RATE = "far_fpr_at_half"
WAYPOINT_ERROR = "position_median_m"
MAX_GROWTH, CHANCE_PAIRS = 1.25, 2.5
"""False links have grown if they are more than this many times as many and so many pairs on top; less is chance."""
EVALUATION_SETS = {"own": "Here", "simulated": "Simulated"}


def far_false_positives_grew(learned: FineTunedWeights) -> bool:
    """Tell whether more far pairs are called reachable than before, in the own place or in simulation."""
    return any(
        _grew(learned, place) for place in EVALUATION_SETS if f"{place}_{FAR_FALSE_POSITIVE_RATE}" in learned.before
    )


def result_lines(learned: FineTunedWeights) -> tuple[str, ...]:
    """Return one line for each place: what it was before and what it is now."""
    return tuple(_line(label, place, learned) for place, label in EVALUATION_SETS.items())


def _grew(learned: FineTunedWeights, place: str) -> bool:
    before, after = (
        learned.before[f"{place}_{FAR_FALSE_POSITIVE_RATE}"],
        learned.after[f"{place}_{FAR_FALSE_POSITIVE_RATE}"],
    )
    return after > MAX_GROWTH * before + CHANCE_PAIRS / max(learned.after[f"{place}_far_pairs"], 1)


def _line(label: str, place: str, learned: FineTunedWeights) -> str:
    parts = []
    for name, key, factor, digits, unit in (
        ("false links", f"{place}_{FAR_FALSE_POSITIVE_RATE}", 100.0, 2, "%"),
        ("waypoint error", f"{place}_{WAYPOINT_ERROR}", 100.0, 1, "cm"),
    ):
        before, after = learned.before.get(key), learned.after.get(key)
        if before is not None and after is not None and before == before and after == after:  # nan: nothing to judge by
            parts.append(f"{name} {factor * before:.{digits}f} → {factor * after:.{digits}f} {unit}")
    return f"{label}: {', '.join(parts) or 'nothing to judge by'}."
