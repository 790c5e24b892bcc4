"""The page's table of the networks that learned the labels of SPTM and ViNG, from the cards beside them.

Owns which numbers of these cards the page shows.
"""

from collections.abc import Mapping
from typing import Any

from figures.metric_names import METRIC_NAMES, format_metric
from ltvn_core.errors import WeightsError

_METRICS = ("accuracy", "auc", "ece", "position_median_m", "position_p90_m", "yaw_median_deg")


def baseline_blocks(cards: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return the page's blocks on rivals, whose cards come by name. Raises WeightsError if a card lacks something."""
    try:
        commands = "\n".join(f"    {command}" for card in cards.values() for command in card["commands"])
        return {"temporal": _table(cards), "temporal-commands": commands}
    except (KeyError, TypeError) as error:
        raise WeightsError(
            f"The card of a rival's weights lacks {error}; train them with `ltvn train --system`."
        ) from error


def _table(cards: Mapping[str, Mapping[str, Any]]) -> str:
    rows = [["", *(f"{name}, {when}" for name in cards for when in ("before", "after"))]]
    rows.append(["---"] * len(rows[0]))
    rows.append(["labelled pairs to learn from", *_twice(card["trained_on"]["pairs"] for card in cards.values())])
    rows.append(["pairs compared in training", *_twice(card["pairs_compared"] for card in cards.values())])
    for key in _METRICS:
        found = [format_metric(card[when][key]) for card in cards.values() for when in ("before", "after")]
        rows.append([METRIC_NAMES.get(key, key), *found])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _twice(numbers: Any) -> list[str]:
    return [cell for number in numbers for cell in ("–", format_metric(number))]
