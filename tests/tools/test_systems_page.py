"""The tables that compare all systems are those of the results in the repository."""

from pathlib import Path

import pytest

from ltvn_core.evaluation.reports.evaluation_files import find_results
from ltvn_core.evaluation.reports.evaluation_tables import overall_table
from ltvn_core.evaluation.reports.result_rows import rows_of
from tests.repository import ROOT
from tools.results_page import fill_blocks, markdown_tables

PAGES = ROOT / "docs" / "systems.md", ROOT / "docs" / "lab-notebook" / "2026-11-systems.md"


@pytest.mark.parametrize("section", ["systems", "foreign"])
def test_the_pages_show_what_was_measured(section: str, tmp_path: Path) -> None:
    results = find_results(ROOT / "docs" / "measurements" / section).results
    tables = {**markdown_tables(results), "overall": overall_table(rows_of(results.trials)).markdown()}

    for page in PAGES:
        written = page.read_text(encoding="utf-8")
        named = {f"{section}-{name}": table for name, table in tables.items()}
        copy = tmp_path / page.name
        copy.write_text(written, encoding="utf-8")
        here = {name: table for name, table in named.items() if f"<!-- {name}: begin -->" in written}
        fill_blocks(copy, here)
        assert here
        assert copy.read_text(encoding="utf-8") == written


def test_the_overall_table_is_the_first_rows_of_the_main_one() -> None:
    results = find_results(ROOT / "docs" / "measurements" / "systems").results
    overall = overall_table(rows_of(results.trials)).markdown()

    assert markdown_tables(results)["main"].startswith(overall)
    assert len(overall.splitlines()) == 12
