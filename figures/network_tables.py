"""Tables of the page about the network, written from the card of the weights, so that no number is copied by hand.

Owns the wording of the card's fields.
"""

import json
from collections.abc import Mapping
from math import degrees
from typing import Any

from figures.metric_names import DRIVING_METRIC_NAMES, METRIC_NAMES, format_metric
from figures.pair_table import limits_from_recipe
from ltvn_core.errors import WeightsError


def network_blocks(card: Mapping[str, Any]) -> dict[str, str]:
    """Return the page's blocks by name. Raises WeightsError if the card lacks what they show."""
    try:
        measured = card["measured"]
        trained = card["trained_on"]
        return {
            "figures": _figures(measured) + _further(card),
            "limits": _limits(trained["recipe"]),
            "training": _training(card, trained),
            "commands": "\n".join(f"    {command}" for command in card["commands"]),
        }
    except (KeyError, TypeError) as error:
        raise WeightsError(
            f"The card of the weights lacks {error}, so there is nothing to write into the page; "
            "train the weights with `ltvn train`, which writes a whole card."
        ) from error


def _figures(measured: Mapping[str, Any]) -> str:
    near = measured["pairs"]
    drives = measured["drive_pairs"]
    keys = list(dict.fromkeys([*near, *drives]))
    rows = [(_name(key), format_metric(near.get(key, "–")), format_metric(drives.get(key, "–"))) for key in keys]
    rest = [(_name(key), "–", format_metric(number)) for key, number in measured["drives"].items()]
    scenes = ", ".join(measured["scenes"])
    head = ("", "labelled neighbours", "all pairs of drives")
    return f"On {scenes}, which training has never seen:\n\n{_table(head, [*rows, *rest])}"


def _further(card: Mapping[str, Any]) -> str:
    """Return a table of the card's single figures from driving and about speed, empty where it has none."""
    rows = [
        (DRIVING_METRIC_NAMES.get(key) or _name(key), _single(value))
        for section in ("driving", "speed")
        for key, value in (card.get(section) or {}).items()
        if _single(value)
    ]
    return f"\n\n{_table(('', 'measured'), rows)}" if rows else ""


def _single(value: object) -> str:
    """Write a number, or a rate with its interval; nothing for anything else."""
    if isinstance(value, Mapping) and {"share", "low", "high", "trials"} <= set(value):
        return f"{value['share']:.3f} ({value['low']:.3f} to {value['high']:.3f}, {value['trials']:,} trials)"
    return format_metric(value) if isinstance(value, int | float) else ""


def _name(key: str) -> str:
    return METRIC_NAMES.get(key, key.replace("_", " "))


def _limits(recipe: str) -> str:
    limits = limits_from_recipe(recipe)
    rows = [
        ("distance", f"below {limits.distance_m:g} m"),
        ("yaw", f"below {degrees(limits.yaw_rad):.0f}°"),
        ("visibility", f"the target's place is ahead, in view and not hidden, or nearer than {limits.at_place_m:g} m"),
        ("overlap", f"the source sees more than {limits.overlap:.0%} of the target's points"),
        ("path", f"the way is below {limits.path_ratio:g} times the straight line"),
        ("line", f"nothing stands within {limits.line_clearance_m:g} m of the straight line"),
    ]
    return _table(("criterion", "holds if"), rows)


def _training(card: Mapping[str, Any], trained: Mapping[str, Any]) -> str:
    # Cards of weights that several processes trained together have their number.
    together = f" in {card['processes']} processes" if "processes" in card else ""
    rows = [
        ("weights", f"`{card['fingerprint']}`"),
        ("apartments to learn from", format_metric(len(trained["scenes"]))),
        ("apartments to choose by", ", ".join(trained["validation_scenes"])),
        ("images", format_metric(trained["images"])),
        ("labelled pairs", format_metric(trained["pairs"])),
        ("clusters per apartment", format_metric(json.loads(trained["recipe"]).get("clusters", "–"))),
        ("pairs compared in training", format_metric(card["pairs_compared"])),
        ("time of training", f"{card['minutes']:.0f} minutes{together}"),
    ]
    return _table(("", "these weights"), rows)


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
