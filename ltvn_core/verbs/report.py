"""`ltvn report`: what an evaluation found, as one HTML page, as JSON, and as the tables of `docs/results.md`."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.reports.docs_extra import require_docs_extra
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.reports.evaluation_files import FoundResults


@dataclass(frozen=True)
class ReportSummary:
    """What was written."""

    output: Path
    results: Path
    """All results in one file."""
    page: Path | None
    pictures: tuple[Path, ...]
    """Of the page."""
    trials: int
    lifelong: int
    worlds: int
    """Maintenances in changing worlds, for each scene and seed."""
    episodes: int
    failed: int
    failures_shown: int


@dataclass(frozen=True, kw_only=True)
class ReportVerb(Verb):
    """Write a report of all results in a folder: figures, tables, and a gallery of failures."""

    folder: Positional[Path]
    """Folder of `ltvn evaluate` and `ltvn lifelong`; results are found in it and in all folders below."""
    output: Path = Path("report.html")
    """The page to write, which needs no other file; the same as JSON goes beside it. An older report is replaced."""
    failures: int = 12
    """Most failed episodes to show for each scene, method and stage."""
    page: Path | None = None
    """A Markdown page whose tables and pictures are to be made anew, such as docs/results.md."""
    images: Path = Path("docs/images/results")
    """Where the pictures of that page go."""
    section: str = ""
    """Part of that page: its marks begin with this word and a dash."""

    def run(self) -> Summary:
        """Read, draw and write; raises OptionError and RecordingError."""
        require_docs_extra()
        from ltvn_core.reports.evaluation_blocks import fill_results_page
        from ltvn_core.reports.evaluation_files import find_results
        from ltvn_core.reports.figure_style import FIGURE_PALETTE

        self._check()
        found = find_results(self.folder)
        shown = self._write(found)
        pictures = ()
        if self.page is not None:
            pictures = fill_results_page(
                found.drawn,
                FIGURE_PALETTE,
                page=self.page,
                images=self.images,
                section=self.section,
                worlds=found.worlds,
            )
        trials = found.results.trials
        return ReportSummary(
            output=self.output,
            results=self._json,
            page=self.page,
            pictures=pictures,
            trials=len(trials),
            lifelong=len(found.results.lifelong),
            worlds=len(found.worlds),
            episodes=sum(len(trial.episodes) for trial in trials),
            failed=len(found.failures),
            failures_shown=shown,
        )

    @property
    def _json(self) -> Path:
        return self.output.with_suffix(".json")

    def _check(self) -> None:
        if self.output.suffix != ".html":
            raise OptionError(f"--output {self.output} must end in .html; the JSON is written beside it.")
        if self.failures < 0:
            raise OptionError(f"--failures must be 0 or more, got {self.failures}.")

    def _write(self, found: "FoundResults") -> int:
        """Write page and JSON, and return how many failures the page shows."""
        from tqdm import tqdm

        from ltvn_core.evaluation.results import save_results
        from ltvn_core.reports.evaluation_files import with_images
        from ltvn_core.reports.evaluation_page import render_page
        from ltvn_core.reports.failure_gallery import select_failures
        from ltvn_core.reports.figure_style import FIGURE_PALETTE

        rows = with_images(tqdm(select_failures(found.failures, self.failures), desc="failures", unit="episode"))
        html = render_page(found.drawn, rows, FIGURE_PALETTE, folder=self.output.parent, worlds=found.worlds)
        parts = [path.with_name(f".{path.name}.part") for path in (self.output, self._json)]
        try:
            self.output.parent.mkdir(parents=True, exist_ok=True)
            parts[1].unlink(missing_ok=True)
            parts[0].write_text(html, encoding="utf-8")
            save_results(parts[1], found.results)
            # Only whole files take the place of an older report.
            os.replace(parts[0], self.output)
            os.replace(parts[1], self._json)
        except OSError as error:
            raise OptionError(f"{self.output} cannot be written ({error.strerror}); name another --output.") from error
        return len(rows)
