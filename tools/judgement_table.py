"""Prints results of `ltvn judge --json` as a Markdown table, for the documentation.

ltvn judge drive.rrd --predictor geometric --json drive-geometric.json
python -m tools.judgement_table drive-*.json
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ltvn_core.evaluation.reports.evaluation_tables import ReportTable

_COLUMNS = (
    ("AUC", "auc", "{:.3f}"),
    ("near found", "near_recall", "{:.1%}"),
    ("far taken for near", "far_fpr", "{:.2%}"),
    ("waypoint", "waypoint_median_m", "{:.3f} m"),
    ("90 %", "waypoint_p90_m", "{:.3f} m"),
    ("yaw", "yaw_median_deg", "{:.1f}°"),
    ("nodes", "nodes", "{}"),
    ("largest piece", "largest_piece_share", "{:.1%}"),
    ("localised", "localised_share", "{:.1%}"),
    ("wrong place", "wrong_place_share", "{:.1%}"),
)


def judgement_table(summaries: list[Mapping[str, Any]]) -> ReportTable:
    """Return a table with a row for each summary."""
    rows = []
    for summary in summaries:
        name = Path(summary["recording"]).stem
        name += f", part {summary['part']}" if summary.get("part", "1/1") != "1/1" else ""
        predictor = summary["predictor"] + (f", {Path(own).name}" if (own := summary.get("weights")) else "")
        against = f" against {Path(summary['against']).stem}" if summary["against"] else ""
        rows.append((f"{name}{against}", predictor, *_cells(summary)))
    head = ("recording", "predictor", *(title for title, _, _ in _COLUMNS))
    return ReportTable(caption="", head=head, rows=tuple(rows), words=2)


def _cells(figures: Mapping[str, Any]) -> list[str]:
    return ["–" if figures[key] is None else pattern.format(figures[key]) for _, key, pattern in _COLUMNS]


def main() -> None:
    """Print the table of the files that are named."""
    summaries = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    sys.stdout.write(judgement_table(summaries).markdown() + "\n")


if __name__ == "__main__":
    main()
