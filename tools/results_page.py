"""Fill the blocks of a Markdown page with tables and figures of results:
`python -m tools.results_page runs/today --page docs/results.md --images docs/images/results --section closed`.

Owns the names of the blocks. Each block is between two comments; text written by hand outside the blocks is not
changed.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.reports.evaluation_figures import figures_of
from ltvn_core.evaluation.reports.evaluation_files import find_results
from ltvn_core.evaluation.reports.evaluation_tables import NO_RESULTS, overall_table, report_tables
from ltvn_core.evaluation.reports.figure_style import (
    FIGURE_PALETTE,
    FigurePalette,
    ReportFigure,
    documentation_style,
    save_png,
)
from ltvn_core.evaluation.reports.result_rows import rows_of
from ltvn_core.evaluation.results import Run

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
        raise OptionError(f"{page}: cannot be filled in ({error}).") from error


def _filled(text: str, name: str, block: str, page: Path) -> str:
    begin = f"<!-- {name}: begin -->"
    end = f"<!-- {name}: end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise OptionError(f"{page}: needs the lines {begin} and {end}, once and in this order.")
    return f"{text[: text.index(begin)]}{begin}\n{block}\n{text[text.index(end) :]}"


def fill_results_page(
    runs: Sequence[Run], palette: FigurePalette, *, page: Path, images: Path, section: str = ""
) -> tuple[Path, ...]:
    """Write the tables into a page and draw the figures for which it has blocks; return the paths of the figures.

    A page need not have all blocks. With a section, blocks and pictures are called `SECTION-NAME`.
    Raises OptionError for a page that is missing or has none of the blocks.
    """
    prefix = f"{section}-" if section else ""
    text = _read(page)
    wanted = [kind for kind in FIGURE_KINDS if _mark(f"{prefix}{kind}-pictures") in text]
    with documentation_style(palette):
        drawn = [figure for figure in figures_of(runs, palette) if figure.kind in wanted]
        files = [(figure, save_png(figure.draw(), images / f"{prefix}{figure.name}.png")) for figure in drawn]
    blocks = markdown_tables(runs) | {f"{kind}-pictures": _links(files, kind, page) for kind in wanted}
    blocks["overall"] = overall_table(rows_of(runs)).markdown()
    named = {f"{prefix}{name}": block for name, block in blocks.items()}
    here = {name: block for name, block in named.items() if _mark(name) in text}
    if not here:
        raise OptionError(f"{page} has none of the lines {', '.join(map(_mark, named))}; put in those that you want.")
    fill_blocks(page, here)
    return tuple(path for _, path in files)


def markdown_tables(runs: Sequence[Run]) -> dict[str, str]:
    """Return the tables of a page by name, in Markdown; those of changing worlds only where there are results."""
    shown = any(run.columns.world for run in runs)
    return {name: table.markdown() for name, table in report_tables(runs).items() if shown or name not in _OF_WORLDS}


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
        raise OptionError(f"{page}: cannot be filled in ({error.strerror}).") from error


def main() -> int:
    """Parse the command line, and fill one page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="Folder of `ltvn evaluate` and `ltvn lifelong`.")
    parser.add_argument("--page", type=Path, required=True)
    parser.add_argument("--images", type=Path, default=Path("docs/images/results"))
    parser.add_argument("--section", default="", help="Its markers begin with this word and a dash.")
    options = parser.parse_args()
    runs = find_results(options.folder)
    pictures = fill_results_page(
        runs, FIGURE_PALETTE, page=options.page, images=options.images, section=options.section
    )
    sys.stdout.write(f"{options.page} filled in, {len(pictures)} figures drawn\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
