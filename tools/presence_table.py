"""Prints how well filters of presence tell when things are there, now and later, as a Markdown table.

python -m tools.presence_table compare --fit monday.npz --test tuesday.npz --ahead 600 --json found.json
python -m tools.presence_table show found.json --page docs/presence.md --block room

Both recordings hold four arrays for each thing N: N.obs and N.obs_t, noisy looks (0 or 1) and their times in s, and
N.gt_obs and N.gt_t, the truth and its times. Filters are fitted to the looks of the first file, judged on the second.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm
from tyro.conf import Positional, subcommand

from ltvn_core.evaluation.reports.evaluation_tables import ReportTable
from ltvn_core.graph.presence.presence_filter import SightErrors
from tools.presence_accuracy import (
    FilterAccuracy,
    PresenceAccuracy,
    filter_accuracy,
    fit_filters,
    read_sequences,
)
from tools.results_page import fill_blocks


@dataclass(frozen=True)
class ComparedFilters:
    """What a comparison found."""

    ahead_s: float
    """So far the filters looked ahead."""
    filters: tuple[FilterAccuracy, ...]

    def table(self) -> ReportTable:
        """Return a table with a row for each filter."""
        head = [f"{name} {when}" for when in ("now", _later(self.ahead_s)) for name in _FIGURES]
        rows = tuple((each.name, *_cells(each.now), *_cells(each.ahead)) for each in self.filters)
        return ReportTable(caption="", head=("filter", *head), rows=rows, words=1)

    def save(self, path: Path) -> None:
        """Write all figures as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> "ComparedFilters":
        """Read what `save` wrote."""
        found = json.loads(path.read_text(encoding="utf-8"))
        filters = (
            FilterAccuracy(each["name"], PresenceAccuracy(**each["now"]), PresenceAccuracy(**each["ahead"]))
            for each in found["filters"]
        )
        return cls(found["ahead_s"], tuple(filters))


@dataclass(frozen=True, kw_only=True)
class Compare:
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
    json: Path | None = None
    """Write the figures to this file, too."""

    def run(self) -> ComparedFilters:
        """Fit and judge; raises OptionError for files of another kind."""
        filters = fit_filters(read_sequences(self.fit), SightErrors(self.miss, self.false_alarm))
        things = read_sequences(self.test)
        found = [filter_accuracy(each, things, ahead_s=self.ahead) for each in tqdm(filters, unit="filter")]
        compared = ComparedFilters(self.ahead, tuple(found))
        if self.json is not None:
            compared.save(self.json)
        return compared


@dataclass(frozen=True, kw_only=True)
class Show:
    """Show what an earlier comparison found."""

    found: Positional[Path]
    """The file that it wrote."""
    page: Path | None = None
    """A Markdown page to put the table into,"""
    block: str = ""
    """and between which of its marks."""

    def run(self) -> ComparedFilters:
        """Read, and fill in the page; raises OptionError for a page without such marks."""
        compared = ComparedFilters.load(self.found)
        if self.page is not None:
            fill_blocks(self.page, {self.block: compared.table().markdown()})
        return compared


_FIGURES = ("Brier", "balanced accuracy", "ECE")


def _later(seconds: float) -> str:
    return f"in {seconds / 60:g} min" if seconds % 60 == 0 else f"in {seconds:g} s"


def _cells(accuracy: PresenceAccuracy) -> tuple[str, ...]:
    return f"{accuracy.brier:.4f}", f"{100 * accuracy.balanced_accuracy:.1f} %", f"{accuracy.ece:.3f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    verb: Compare | Show = tyro.cli(
        Annotated[Compare, subcommand("compare")] | Annotated[Show, subcommand("show")],  # type: ignore[arg-type]
        args=arguments,
    )
    sys.stdout.write(verb.run().table().markdown() + "\n")


if __name__ == "__main__":
    main()
