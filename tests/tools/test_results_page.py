"""Tables and pictures are written between the marks of a page, and the rest is left alone."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import EncounterCounts
from ltvn_core.evaluation.reports.evaluation_files import find_results
from ltvn_core.evaluation.reports.evaluation_tables import overall_table
from ltvn_core.evaluation.reports.figure_style import MAX_BYTES, FigurePalette
from ltvn_core.evaluation.reports.result_rows import rows_of
from tests.core.evaluation.reports.fake_results import (
    keep,
    make_lifelong_result,
    make_trial,
    make_world_result,
    run_of,
    runs_of,
)
from tests.repository import ROOT
from tools.results_page import FIGURE_KINDS, fill_blocks, fill_results_page, markdown_tables

PAGE = ROOT / "docs" / "lab-notebook" / "2026-11-results.md"
INK = FigurePalette((0.1, 0.3, 0.7), (0.8, 0.3, 0.1), (0.5, 0.2, 0.6))


@pytest.mark.slow
def test_the_pages_blocks_are_filled_and_its_images_are_small(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    trials = make_trial(), make_trial(method="sptm", nodes=200), make_trial(without=("pruning",))
    for run in (*runs_of(*trials), make_lifelong_result(points=2)):
        keep(folder, run)
    page_file, images = tmp_path / "docs" / "lab-notebook" / "results.md", tmp_path / "docs" / "images"
    page_file.parent.mkdir(parents=True)
    page_file.write_text(PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    pictures = fill_results_page(find_results(folder), INK, page=page_file, images=images)
    text = page_file.read_text(encoding="utf-8")
    links = re.findall(r"!\[[^]]*\]\((?!../images/results/(?:house|paper)-)([^)]*)\)", text)
    assert {(page_file.parent / link).resolve() for link in links} == {path.resolve() for path in pictures}
    assert "No results yet." not in text
    for path in pictures:
        assert path.stat().st_size <= MAX_BYTES
        assert len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0)) > 5


def test_a_part_of_a_page_has_marks_and_images_of_its_own(tmp_path: Path) -> None:
    keep(tmp_path, run_of(make_trial(plan=False)))
    page_file = tmp_path / "results.md"
    page_file.write_text(
        "".join(
            f"<!-- {name}: begin -->\n<!-- {name}: end -->\n"
            for name in ("main", "house-main", "house-causes-pictures")
        ),
        encoding="utf-8",
    )
    results = find_results(tmp_path)
    pictures = fill_results_page(results, INK, page=page_file, images=tmp_path, section="house")
    assert [path.name for path in pictures] == ["house-causes.png"]
    first, second = page_file.read_text(encoding="utf-8").split("<!-- main: end -->")
    assert "tune-1" not in first
    assert "tune-1" in second
    with pytest.raises(OptionError, match="flat-main"):
        fill_results_page(results, INK, page=page_file, images=tmp_path, section="flat")


def test_the_page_in_the_repository_has_every_block() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name in [*markdown_tables(()), *(f"{kind}-pictures" for kind in FIGURE_KINDS)]:
        assert text.count(f"<!-- {name}: begin -->") == text.count(f"<!-- {name}: end -->") == 1


def test_worlds_that_change_have_tables_of_their_own(tmp_path: Path) -> None:
    for name in ("static", "persistent"):
        keep(tmp_path, make_world_result(maintenance=name))
    page_file = tmp_path / "results.md"
    names = "changing-worlds", "changing-world-runs"
    page_file.write_text("".join(f"<!-- {name}: begin -->\n<!-- {name}: end -->\n" for name in names), encoding="utf-8")
    found = find_results(tmp_path)
    fill_results_page(found, INK, page=page_file, images=tmp_path, section="changing")
    rows = [
        line.split(" | ") for line in page_file.read_text(encoding="utf-8").splitlines() if line.startswith("| doors")
    ]
    assert [row[2] for row in rows] == ["static", "persistent", "static, persistent"]
    assert rows[0][3].startswith("50.0 % (")


def test_people_whom_the_robot_met_have_a_table(tmp_path: Path) -> None:
    met = EncounterCounts(
        encounters=3, touched=1, avoidable=0, gave_way=2, closest_m=0.0, closest_each_m=(0.0, 0.3, 0.6), stood_s=6.0
    )
    made = make_world_result("people")
    keep(tmp_path, replace(made, queries=(replace(made.queries[0], people=met), made.queries[1])))
    keep(tmp_path, make_world_result())
    page_file = tmp_path / "results.md"
    page_file.write_text("<!-- met-people: begin -->\n<!-- met-people: end -->\n", encoding="utf-8")
    found = find_results(tmp_path)
    fill_results_page(found, INK, page=page_file, images=tmp_path, section="met")
    (row,) = [
        line.strip("| ").split(" | ")
        for line in page_file.read_text(encoding="utf-8").splitlines()
        if line.startswith("| people")
    ]
    assert row[3:12] == ["3", "1", "0", "0.00", "0.01", "0.06", "0.30", "66.7 %", "2.0"]


def test_results_of_one_command_are_one_row_that_names_their_scenes_and_seeds() -> None:
    made = [make_trial(scene, seed=seed) for scene in ("tune-1", "tune-2") for seed in (0, 1)]
    trials = tuple(replace(trial, command="ltvn evaluate --seed 0 1") for trial in made)
    worlds = [make_world_result(maintenance=name) for name in ("static", "persistent")]

    tables = markdown_tables((*runs_of(*trials), *worlds))

    (row,) = tables["runs"].splitlines()[2:]
    assert "| tune-1, tune-2 | 0, 1 |" in row
    (row,) = tables["world-runs"].splitlines()[2:]
    assert "| static, persistent |" in row


PAGES = ROOT / "docs" / "systems.md", ROOT / "docs" / "lab-notebook" / "2026-11-systems.md"


@pytest.mark.parametrize("section", ["systems", "foreign"])
def test_the_pages_show_what_was_measured(section: str, tmp_path: Path) -> None:
    results = find_results(ROOT / "docs" / "measurements" / section)
    tables = {**markdown_tables(results), "overall": overall_table(rows_of(results)).markdown()}

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
    results = find_results(ROOT / "docs" / "measurements" / "systems")
    overall = overall_table(rows_of(results)).markdown()

    assert markdown_tables(results)["main"].startswith(overall)
    assert len(overall.splitlines()) == 12
