"""The evaluation report as one self-contained HTML page.

Owns the contents of the page. The HTML layout is in `templates/`; numbers and pictures come from other modules.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ltvn_core.evaluation.reports.evaluation_figures import figures_of
from ltvn_core.evaluation.reports.evaluation_tables import percent, report_tables
from ltvn_core.evaluation.reports.failure_gallery import FailureRow, data_url
from ltvn_core.evaluation.reports.figure_style import (
    FigurePalette,
    documentation_style,
    inline_svg,
)
from ltvn_core.evaluation.reports.result_rows import (
    ResultRow,
    grouped,
    rows_of,
    rows_over_scenes,
    scenes_of,
    static_tests,
)
from ltvn_core.evaluation.results import Run


def render_page(runs: Sequence[Run], failures: Sequence[FailureRow], palette: FigurePalette, *, folder: Path) -> str:
    """Return the report as HTML for a file in `folder`, with these failures in its gallery.

    Raises OptionError if an image of the gallery is neither JPEG nor PNG.
    """
    with documentation_style(palette):
        pictures = [(picture, Markup(inline_svg(picture, palette))) for picture in figures_of(runs, palette)]
    return _template(folder).render(
        headline=headline(rows_of(runs)),
        pictures=pictures,
        **{name.replace("-", "_"): table for name, table in report_tables(runs).items()},
        groups=grouped(failures, lambda row: f"{row.scene}: {row.heading}"),
        shown=len(failures),
        failed=sum(not episode.reached for trial in static_tests(runs) for episode in trial.episodes),
    )


def headline(rows: Sequence[ResultRow]) -> str:
    """Return the main result as a sentence: success of each method at its last stage, over all scenes."""
    whole = [row for row in rows if not row.setup.ablated]
    first = [row for row in whole if not row.trials[0].columns.conditions] or whole
    count = len(scenes_of(first))
    latest = {row.setup.method: row for row in (rows_over_scenes(first) if count > 1 else first)}
    shares = [f"{method} {percent(row.success.mean, 0)}" for method, row in latest.items()]
    return f"Goals reached in {count} {'scene' if count == 1 else 'scenes'}: {', '.join(shares)}." if shares else ""


def _template(folder: Path) -> Any:
    world = Environment(
        loader=PackageLoader("ltvn_core.evaluation.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    world.filters["data_address"] = data_url
    world.filters["beside"] = lambda path: quote(os.path.relpath(path, folder))
    return world.get_template("report.html")
