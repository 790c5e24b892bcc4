"""The report of an evaluation in a browser: its tables are sorted by a click, and nothing hides on a phone."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from ltvn_core.evaluation.reports.evaluation_page import render_page
from ltvn_core.evaluation.reports.failure_gallery import FailureRow
from ltvn_core.evaluation.reports.figure_style import FigurePalette
from tests.core.evaluation.reports.fake_results import make_trial, runs_of

INK = FigurePalette((0.1, 0.3, 0.7), (0.8, 0.3, 0.1), (0.5, 0.2, 0.6))
METHODS = ("ltvn", "sptm", "ving")


@pytest.fixture
def report(tmp_path: Path) -> Path:
    trials = tuple(
        replace(make_trial("tune-1", method, plan=False), command=f"ltvn evaluate --system {method}")
        for method in METHODS
    )
    failures = [FailureRow(trial, each) for trial in trials for each in trial.episodes if not each.reached]
    path = tmp_path / "report.html"
    path.write_text(render_page(runs_of(*trials), failures, INK, folder=tmp_path), encoding="utf-8")
    return path


@pytest.fixture
def page(chromium: Browser) -> Iterator[Page]:
    page = chromium.new_page()
    yield page
    page.close()


def test_a_table_is_sorted_by_the_column_that_is_clicked(report: Path, page: Page) -> None:
    page.goto(report.as_uri())
    table = page.get_by_role("table").filter(has_text="SPL, collisions and steps")
    heading = table.get_by_role("columnheader", name="SPL")
    first = _column(table, 4)

    heading.get_by_role("button").click()
    expect(heading).to_have_attribute("aria-sort", "descending")
    assert _column(table, 4) == sorted(first, reverse=True)
    heading.get_by_role("button").click()
    expect(heading).to_have_attribute("aria-sort", "ascending")
    assert _column(table, 4) == sorted(first)
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") is None
    assert _column(table, 4) == first

    table.get_by_role("columnheader", name="method").get_by_role("button").press("Enter")
    assert _column(table, 1) == sorted(_column(table, 1))


def test_on_a_phone_tables_scroll_and_the_page_does_not(report: Path, page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(report.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    wide = page.get_by_role("region", name="Goals reached with 95 %")
    assert wide.evaluate("each => each.scrollWidth > each.clientWidth")
    wide.focus()
    expect(wide).to_be_focused()


def _column(table: Locator, number: int) -> list[str]:
    return table.locator(f"tbody tr td:nth-child({number + 1})").all_inner_texts()
