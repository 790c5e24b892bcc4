"""The evaluation as blocks of a Markdown page: its tables, and links to its figures.

Owns the names of the blocks, and the two comments between which each stands. What is written between the blocks by hand
stays as it is.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.results import EvaluationResults, WorldResult
from ltvn_core.reports.evaluation_figures import figures_of
from ltvn_core.reports.evaluation_tables import (
    NO_RESULTS,
    cause_table,
    lifelong_table,
    main_table,
    margin_table,
    recognition_table,
    run_table,
    size_table,
)
from ltvn_core.reports.figure_style import FigurePalette, ReportFigure, documentation_style, save_png
from ltvn_core.reports.lifelong_groups import group_lifelong
from ltvn_core.reports.result_rows import rows_of
from ltvn_core.reports.world_tables import people_table, world_run_table, world_table

FIGURE_KINDS = ("success", "sizes", "causes", "floors", "lifelong", "calibration")
"""Kinds of figures; each has a block `KIND-pictures`."""


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
    named = {f"{prefix}{name}": block for name, block in blocks.items()}
    here = {name: block for name, block in named.items() if _mark(name) in text}
    if not here:
        raise OptionError(f"{page} has none of the lines {', '.join(map(_mark, named))}; put in those that you want.")
    fill_blocks(page, here)
    return tuple(path for _, path in files)


def markdown_tables(results: EvaluationResults, worlds: Sequence[WorldResult] = ()) -> dict[str, str]:
    """Return the tables of a page by name, in Markdown; those of changing worlds only where there are results."""
    rows = rows_of(results.trials)
    lifelong_groups = group_lifelong(results.lifelong)
    tables = {
        "main": main_table(rows),
        "margins": margin_table(rows),
        "sizes": size_table(rows),
        "causes": cause_table(rows),
        "recognition": recognition_table(rows),
        "lifelong": lifelong_table(lifelong_groups),
        "runs": run_table(results),
    }
    if worlds:
        tables |= {
            "worlds": world_table(worlds),
            "people": people_table(worlds),
            "world-runs": world_run_table(worlds),
        }
    return {name: table.markdown() for name, table in tables.items()}


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
