"""`ltvn report`: the results of an evaluation, as one HTML page and as JSON."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.outputs import ReplacedFile
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class ReportVerb(Verb):
    """Write a report of all results in a folder: figures, tables, and a gallery of failures."""

    job = "ltvn_core.verbs.jobs.report:write_report"

    folder: Positional[Path]
    """Folder of `ltvn evaluate` and `ltvn lifelong`; results in its subfolders are also used."""
    output: ReplacedFile = Path("report.html")
    """The page to write, a single file; a JSON file with the same results is written beside it. An older report is
    replaced."""
    failures: int = 12
    """Greatest number of failed episodes to show for each scene, method and stage."""
