"""Tables that set networks beside each other, from the summaries of `ltvn train --evaluate --json FILE`.

Owns which summaries make which table. The summaries are kept with the page, so that every number can be traced.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from figures.metric_names import METRIC_NAMES, format_metric
from ltvn_core.errors import OptionError

COMPARED_METRICS = (
    "far_fpr_at_tpr60",
    "far_pairs",
    "auc",
    "position_median_m",
    "position_median_1_to_1_5_m",
    "position_p90_m",
    "yaw_median_deg",
    "ece",
    "pairs",
)
"""Figures that a comparison shows."""

Columns = Mapping[str, tuple[str, str | None]]
"""Head of each column, with the summary's file and the part of it that is meant."""

TABLES: Mapping[str, Columns] = {
    "rivals": {"this network": ("shipped.json", None), "stacked images": ("shipped.json", "stacked")},
    "house": {
        "house, before": ("house-before.json", None),
        "house, after": ("house-after.json", None),
        "house, after, poor odometry": ("house-noisy.json", None),
        "apartments, before": ("shipped.json", None),
        "apartments, after": ("apartments-after.json", None),
    },
}
"""The page's comparisons by name."""


def comparison_tables(folder: Path) -> dict[str, str]:
    """Return the tables whose summaries all lie in a folder. Raises OptionError for one that is damaged."""
    files = {path.name: _summary(path) for path in sorted(folder.glob("*.json"))}
    found = {}
    for name, columns in TABLES.items():
        if all(file in files for file, _ in columns.values()):
            parts = {head: files[file] if part is None else files[file][part] for head, (file, part) in columns.items()}
            found[name] = _table(parts)
    return found


def _summary(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise OptionError(
            f"{path}: not a summary ({error}); write it again with `ltvn train --evaluate --json`."
        ) from error


def _table(parts: Mapping[str, Mapping[str, Any]]) -> str:
    lines = ["|  | " + " | ".join(parts) + " |", "| --- |" + " --- |" * len(parts)]
    for key in COMPARED_METRICS:
        cells = [format_metric(part[key]) for part in parts.values()]
        lines.append(f"| {METRIC_NAMES.get(key, key)} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
