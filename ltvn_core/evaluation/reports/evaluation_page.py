"""The evaluation report as one self-contained HTML page, and as blocks of a page in Markdown.

Owns the contents of the pages and the names of the blocks. Each block is between two comments; text written by hand
outside the blocks is not changed. The HTML layout is in `templates/`; numbers and pictures come from other modules.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.reports.evaluation_figures import figures_of
from ltvn_core.evaluation.reports.evaluation_tables import (
    NO_RESULTS,
    ReportTable,
    cause_table,
    lifelong_table,
    main_table,
    margin_table,
    overall_table,
    percent,
    recognition_table,
    run_table,
    size_table,
)
from ltvn_core.evaluation.reports.failure_gallery import FailureRow, data_url
from ltvn_core.evaluation.reports.figure_style import (
    FigurePalette,
    ReportFigure,
    documentation_style,
    inline_svg,
    save_png,
)
from ltvn_core.evaluation.reports.result_rows import ResultRow, group_lifelong, rows_of, rows_over_scenes, scenes_of
from ltvn_core.evaluation.reports.world_tables import people_table, world_run_table, world_table
from ltvn_core.evaluation.results import EvaluationResults, WorldResult


def render_page(
    results: EvaluationResults,
    failures: Sequence[FailureRow],
    palette: FigurePalette,
    *,
    folder: Path,
    worlds: Sequence[WorldResult] = (),
) -> str:
    """Return the report as HTML for a file in `folder`, with these failures in its gallery.

    Raises OptionError if an image of the gallery is neither JPEG nor PNG.
    """
    with documentation_style(palette):
        pictures = [(picture, Markup(inline_svg(picture, palette))) for picture in figures_of(results, palette)]
    return _template(folder).render(
        headline=headline(rows_of(results.trials)),
        pictures=pictures,
        **{name.replace("-", "_"): table for name, table in report_tables(results, worlds).items()},
        groups=_grouped(failures),
        shown=len(failures),
        failed=sum(not episode.reached for trial in results.trials for episode in trial.episodes),
    )


def headline(rows: Sequence[ResultRow]) -> str:
    """Return the main result as a sentence: success of each method at its last stage, over all scenes."""
    whole = [row for row in rows if not row.setup.ablated]
    first = [row for row in whole if not row.trials[0].conditions] or whole
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


def _grouped(rows: Sequence[FailureRow]) -> dict[str, list[FailureRow]]:
    groups: dict[str, list[FailureRow]] = {}
    for row in rows:
        groups.setdefault(f"{row.scene}: {row.heading}", []).append(row)
    return groups


FIGURE_KINDS = ("success", "sizes", "causes", "floors", "lifelong", "calibration")
"""Kinds of figures; each has a block `KIND-pictures`."""
_OF_WORLDS = ("worlds", "people", "world-runs")


def fill_blocks(page: Path, content: Mapping[str, str]) -> None:
    """Put each block between its two comments in a page. Raises OptionError if page or comments are missing."""
    try:
        text = page.read_text(encoding="utf-8")
        for name, block in content.items():
            text = _filled(text, name, block, page)
        page.write_text(text, encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{page}: cannot be filled in ({error}); name another --page.") from error


def _filled(text: str, name: str, block: str, page: Path) -> str:
    begin = f"<!-- {name}: begin -->"
    end = f"<!-- {name}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise OptionError(f"{page}: needs the lines {begin} and {end}, once and in this order.")
    return f"{text[: text.index(begin)]}{begin}\n{block}\n{text[text.index(end) :]}"


def fill_results_page(
    results: EvaluationResults,
    palette: FigurePalette,
    *,
    page: Path,
    images: Path,
    section: str = "",
    worlds: Sequence[WorldResult] = (),
) -> tuple[Path, ...]:
    """Write the tables into a page and draw the figures for which it has blocks; return the paths of the figures.

    A page need not have all blocks. With a section, blocks and pictures are called `SECTION-NAME`.
    Raises OptionError for a page that is missing or has none of the blocks.
    """
    prefix = f"{section}-" if section else ""
    text = _read(page)
    wanted = [kind for kind in FIGURE_KINDS if _mark(f"{prefix}{kind}-pictures") in text]
    with documentation_style(palette):
        drawn = [figure for figure in figures_of(results, palette) if figure.kind in wanted]
        files = [(figure, save_png(figure.draw(), images / f"{prefix}{figure.name}.png")) for figure in drawn]
    blocks = markdown_tables(results, worlds) | {f"{kind}-pictures": _links(files, kind, page) for kind in wanted}
    blocks["overall"] = overall_table(rows_of(results.trials)).markdown()
    named = {f"{prefix}{name}": block for name, block in blocks.items()}
    here = {name: block for name, block in named.items() if _mark(name) in text}
    if not here:
        raise OptionError(f"{page} has none of the lines {', '.join(map(_mark, named))}; put in those that you want.")
    fill_blocks(page, here)
    return tuple(path for _, path in files)


def markdown_tables(results: EvaluationResults, worlds: Sequence[WorldResult] = ()) -> dict[str, str]:
    """Return the tables of a page by name, in Markdown; those of changing worlds only where there are results."""
    tables = report_tables(results, worlds)
    return {name: table.markdown() for name, table in tables.items() if worlds or name not in _OF_WORLDS}


def report_tables(results: EvaluationResults, worlds: Sequence[WorldResult]) -> dict[str, ReportTable]:
    """Return all tables by name."""
    rows = rows_of(results.trials)
    return {
        "main": main_table(rows),
        "margins": margin_table(rows),
        "sizes": size_table(rows),
        "causes": cause_table(rows),
        "recognition": recognition_table(rows),
        "lifelong": lifelong_table(group_lifelong(results.lifelong)),
        "runs": run_table(results),
        "worlds": world_table(worlds),
        "people": people_table(worlds),
        "world-runs": world_run_table(worlds),
    }


def _links(files: Iterable[tuple[ReportFigure, Path]], kind: str, page: Path) -> str:
    links = [
        f"![{figure.title}]({Path(os.path.relpath(path, page.parent)).as_posix()})\n\n{figure.caption}"
        for figure, path in files
        if figure.kind == kind
    ]
    return "\n\n".join(links) or NO_RESULTS


def _mark(name: str) -> str:
    return f"<!-- {name}: begin -->"


def _read(page: Path) -> str:
    try:
        return page.read_text(encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{page}: cannot be filled in ({error.strerror}); name another --page.") from error
