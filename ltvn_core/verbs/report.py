"""`ltvn report`: what an evaluation found, as one HTML page, as JSON, and as the tables of `docs/results.md`."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ReportVerb(Verb):
    """Write a report of all results in a folder: figures, tables, and a gallery of failures."""

    job = "ltvn_core.verbs.jobs.report:write_report"

    folder: Positional[Path]
    """Folder of `ltvn evaluate` and `ltvn lifelong`; results are found in it and in all folders below."""
    output: Path = Path("report.html")
    """The page to write, which needs no other file; the same as JSON goes beside it. An older report is replaced."""
    failures: int = 12
    """Most failed episodes to show for each scene, method and stage."""
    page: Path | None = None
    """A Markdown page whose tables and pictures are to be updated, such as docs/results.md."""
    images: Path = Path("docs/images/results")
    """Folder of the figures of that page."""
    section: str = ""
    """Part of that page: its marks begin with this word and a dash."""
