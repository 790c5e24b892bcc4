"""Prints how well filters of presence tell when things are there, now and later, as a Markdown table.

python -m tools.presence_table --fit monday.npz --test tuesday.npz --ahead 600

Both files hold four arrays for each thing N: N.obs and N.obs_t, noisy looks (0 or 1) and their times in s, N.gt_obs and
N.gt_t, the truth and its times. Filters are fitted to the looks of the first file and judged on the second.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from tqdm import tqdm

from ltvn_core.evaluation.presence.accuracy import FilterAccuracy, PresenceAccuracy, filter_accuracy
from ltvn_core.evaluation.presence.filter_fit import fit_filters
from ltvn_core.evaluation.presence.sequences import read_sequences
from ltvn_core.graph.presence.persistent import SightErrors
from ltvn_core.reports.evaluation_tables import ReportTable


@dataclass(frozen=True, kw_only=True)
class PresenceTable:
    """Compare filters of presence on recorded sequences."""

    fit: Path
    """What the filters learn from; its truth is not read."""
    test: Path
    """What they are judged on: the same things at another time."""
    ahead: float = 600.0
    """Seconds that they look ahead."""
    miss: float = 0.1
    """Share of looks at a thing that miss it."""
    false_alarm: float = 0.1
    """Share of looks that find a thing that is not there."""


def presence_table(options: PresenceTable) -> ReportTable:
    """Return a table with a row for each filter; raises OptionError for files of another kind."""
    filters = fit_filters(read_sequences(options.fit), SightErrors(options.miss, options.false_alarm))
    things = read_sequences(options.test)
    found = [filter_accuracy(each, things, ahead_s=options.ahead) for each in tqdm(filters, unit="filter")]
    later = f"in {options.ahead:g} s"
    head = ("filter", *(f"{name} {when}" for when in ("now", later) for name in ("Brier", "balanced accuracy", "ECE")))
    return ReportTable(caption="", head=head, rows=tuple(map(_row, found)), words=1)


def _row(found: FilterAccuracy) -> tuple[str, ...]:
    return (found.name, *_cells(found.now), *_cells(found.ahead))


def _cells(accuracy: PresenceAccuracy) -> tuple[str, ...]:
    return f"{accuracy.brier:.4f}", f"{accuracy.balanced_accuracy:.1%}", f"{accuracy.ece:.3f}"


def main() -> None:
    """Print the table."""
    sys.stdout.write(presence_table(tyro.cli(PresenceTable)).markdown() + "\n")


if __name__ == "__main__":
    main()
