"""The evaluation as blocks of a Markdown page: its tables, and links to its pictures.

Owns the names of the blocks. What is written between them by hand stays as it is.
"""

import os
from collections.abc import Iterable
from pathlib import Path

from ltvn_core.errors import OptionError
from ltvn_core.evaluate.results import Results
from ltvn_core.report.evaluation_courses import courses_of
from ltvn_core.report.evaluation_pictures import pictures_of
from ltvn_core.report.evaluation_rows import rows_of
from ltvn_core.report.evaluation_style import Picture
from ltvn_core.report.evaluation_tables import (
    NOTHING,
    cause_table,
    lifelong_table,
    main_table,
    margin_table,
    run_table,
    size_table,
)
from ltvn_core.report.style import Ink, drawing, save
from ltvn_core.report.tables import fill

KINDS = ("success", "sizes", "causes", "floors", "lifelong", "calibration")
"""Kinds of pictures; each has a block `KIND-pictures`."""


def fill_page(results: Results, ink: Ink, *, page: Path, images: Path, section: str = "") -> tuple[Path, ...]:
    """Write tables into a page and draw the pictures that it asks for; returns the pictures.

    A page need not have all blocks. With a section, blocks and pictures are called `SECTION-NAME`.
    Raises OptionError for a page that is missing or has none of the blocks.
    """
    prefix, text = f"{section}-" if section else "", _read(page)
    wanted = [kind for kind in KINDS if _mark(f"{prefix}{kind}-pictures") in text]
    with drawing(ink):
        drawn = [picture for picture in pictures_of(results, ink) if picture.kind in wanted]
        files = [(picture, save(picture.draw(), images / f"{prefix}{picture.name}.png")) for picture in drawn]
    blocks = tables_of(results) | {f"{kind}-pictures": _links(files, kind, page) for kind in wanted}
    named = {f"{prefix}{name}": block for name, block in blocks.items()}
    here = {name: block for name, block in named.items() if _mark(name) in text}
    if not here:
        raise OptionError(f"{page} has none of the lines {', '.join(map(_mark, named))}; put in those that you want.")
    fill(page, here)
    return tuple(path for _, path in files)


def tables_of(results: Results) -> dict[str, str]:
    """Return the tables of a page by name, in Markdown."""
    rows, courses = rows_of(results.trials), courses_of(results.lifelong)
    tables = {
        "main": main_table(rows),
        "margins": margin_table(rows),
        "sizes": size_table(rows),
        "causes": cause_table(rows),
        "lifelong": lifelong_table(courses),
        "runs": run_table(results),
    }
    return {name: table.markdown() for name, table in tables.items()}


def _links(files: Iterable[tuple[Picture, Path]], kind: str, page: Path) -> str:
    links = [
        f"![{picture.title}]({Path(os.path.relpath(path, page.parent)).as_posix()})\n\n{picture.caption}"
        for picture, path in files
        if picture.kind == kind
    ]
    return "\n\n".join(links) or NOTHING


def _mark(name: str) -> str:
    return f"<!-- {name}: begin -->"


def _read(page: Path) -> str:
    try:
        return page.read_text(encoding="utf-8")
    except OSError as error:
        raise OptionError(f"{page}: cannot be filled in ({error.strerror}); name another --page.") from error
