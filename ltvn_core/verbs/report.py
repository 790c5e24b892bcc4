"""`ltvn report`: the results of an evaluation, as one HTML page and as JSON."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import OptionError
from ltvn_core.verbs.outputs import ReplacedFile
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.evaluation.reports.failure_gallery import FailureRow
    from ltvn_core.evaluation.results import Run


@dataclass(frozen=True)
class ReportSummary:
    """The files that were written."""

    output: Path
    results: Path
    """JSON file with all results."""
    trials: int
    lifelong: int
    worlds: int
    """Number of maintenances in changing worlds, for each scene and seed."""
    episodes: int
    failed: int
    failures_shown: int


@dataclass(frozen=True, kw_only=True)
class ReportVerb(Verb):
    """Write a report of all results in a folder: figures, tables, and a gallery of failures."""

    folder: Positional[Path]
    """Folder of `ltvn evaluate` and `ltvn lifelong`; results in its subfolders are also used."""
    output: ReplacedFile = Path("report.html")
    """The page to write, a single file; a JSON file with the same results is written beside it. An older report is
    replaced."""
    failures: int = 12
    """Greatest number of failed episodes to show for each scene, method and stage."""

    def run(self) -> Summary:
        """Read, draw and write; raises OptionError and RecordingError."""
        from ltvn_core.evaluation.reports.evaluation_files import failed_episodes, find_results
        from ltvn_core.evaluation.reports.result_rows import static_tests

        _check(self)
        runs = find_results(self.folder)
        failed = failed_episodes(runs)
        shown = _write(self, runs, failed)
        trials = static_tests(runs)
        worlds = sum(run.columns.world is not None for run in runs)
        return ReportSummary(
            output=self.output,
            results=_json(self),
            trials=len(trials),
            lifelong=len(runs) - len(trials) - worlds,
            worlds=worlds,
            episodes=sum(len(trial.episodes) for trial in trials),
            failed=len(failed),
            failures_shown=shown,
        )


def _json(options: ReportVerb) -> Path:
    return options.output.with_suffix(".json")


def _check(options: ReportVerb) -> None:
    if options.output.suffix != ".html":
        raise OptionError(f"--output {options.output} must end in .html; the JSON is written beside it.")
    if options.failures < 0:
        raise OptionError(f"--failures must be 0 or more, got {options.failures}.")


def _write(options: ReportVerb, runs: "Sequence[Run]", failed: "Sequence[FailureRow]") -> int:
    """Write page and JSON, and return the number of failures on the page."""
    from tqdm import tqdm

    from ltvn_core.evaluation.reports.evaluation_files import with_images
    from ltvn_core.evaluation.reports.evaluation_page import render_page
    from ltvn_core.evaluation.reports.failure_gallery import select_failures
    from ltvn_core.evaluation.reports.figure_style import FIGURE_PALETTE
    from ltvn_core.evaluation.results import json_rows

    rows = with_images(tqdm(select_failures(failed, options.failures), desc="failures", unit="episode"))
    html = render_page(runs, rows, FIGURE_PALETTE, folder=options.output.parent)
    try:
        # An older report is replaced only when the new files are complete.
        with atomic_replacement(options.output) as page, atomic_replacement(_json(options)) as results:
            page.write_text(html, encoding="utf-8")
            results.write_text(json_rows(runs), encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{options.output} cannot be written ({error.strerror}); name another --output.") from error
    return len(rows)
