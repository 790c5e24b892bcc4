"""The report as one HTML page that asks nothing of any other machine.

Owns what goes into the page. How it looks is in `templates/`; numbers and pictures come from the other modules.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ltvn_core.evaluate.results import Results
from ltvn_core.report.evaluation_courses import courses_of
from ltvn_core.report.evaluation_gallery import GalleryRow, data_address
from ltvn_core.report.evaluation_pictures import pictures_of
from ltvn_core.report.evaluation_rows import Row, rows_of, rows_over_scenes, scenes_of
from ltvn_core.report.evaluation_style import inline_svg
from ltvn_core.report.evaluation_tables import (
    cause_table,
    lifelong_table,
    main_table,
    margin_table,
    run_table,
    share,
    size_table,
)
from ltvn_core.report.style import Ink, drawing


def page(results: Results, failures: Sequence[GalleryRow], ink: Ink, *, folder: Path) -> str:
    """Return the report as HTML that is to lie in `folder`, with these failures for its gallery.

    Raises OptionError for a picture of the gallery that is none.
    """
    rows, courses = rows_of(results.trials), courses_of(results.lifelong)
    with drawing(ink):
        pictures = [(picture, Markup(inline_svg(picture, ink))) for picture in pictures_of(results, ink)]
    return _template(folder).render(
        headline=headline(rows),
        pictures=pictures,
        main=main_table(rows),
        margins=margin_table(rows),
        sizes=size_table(rows),
        causes=cause_table(rows),
        lifelong=lifelong_table(courses),
        runs=run_table(results),
        groups=_grouped(failures),
        shown=len(failures),
        failed=sum(not episode.reached for trial in results.trials for episode in trial.episodes),
    )


def headline(rows: Sequence[Row]) -> str:
    """Return the result in a sentence: the share of each method at its furthest stage, over all scenes."""
    first = [row for row in rows if not row.setup.ablated]
    count = len(scenes_of(first))
    latest = {row.setup.method: row for row in (rows_over_scenes(first) if count > 1 else first)}
    said = [f"{method} {share(row.success.mean, 0)}" for method, row in latest.items()]
    return f"Goals reached in {count} {'scene' if count == 1 else 'scenes'}: {', '.join(said)}." if said else ""


def _template(folder: Path) -> Any:
    world = Environment(
        loader=PackageLoader("ltvn_core.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    world.filters["data_address"] = data_address
    world.filters["beside"] = lambda path: quote(os.path.relpath(path, folder))
    return world.get_template("report.html")


def _grouped(rows: Sequence[GalleryRow]) -> dict[str, list[GalleryRow]]:
    groups: dict[str, list[GalleryRow]] = {}
    for row in rows:
        groups.setdefault(f"{row.scene}: {row.heading}", []).append(row)
    return groups
