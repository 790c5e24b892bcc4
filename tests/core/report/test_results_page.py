"""`ltvn report --page` writes tables and pictures between the marks of docs/results.md and leaves the rest alone."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ltvn_core.errors import OptionError
from ltvn_core.evaluate.results import Results, save_results
from ltvn_core.report.evaluation_blocks import KINDS, fill_page, tables_of
from ltvn_core.report.evaluation_files import find_results
from ltvn_core.report.style import MOST_BYTES, Ink
from ltvn_core.verbs.report import Report, Reported
from tests.core.report.found import a_lifelong, a_trial

PAGE = Path(__file__).parents[3] / "docs" / "results.md"
INK = Ink((0.1, 0.3, 0.7), (0.8, 0.3, 0.1), (0.5, 0.2, 0.6))


def test_the_pages_blocks_are_filled_and_its_pictures_are_small(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    for number, trial in enumerate((a_trial(), a_trial(method="sptm", nodes=200), a_trial(without=("pruning",)))):
        save_results(folder / f"{number}.trial.json", trial)
    save_results(folder / "ltvn-100-20.lifelong.json", a_lifelong(points=2))
    page_file, images = tmp_path / "docs" / "results.md", tmp_path / "docs" / "images"
    page_file.parent.mkdir()
    page_file.write_text(PAGE.read_text())
    pictures = fill_page(find_results(folder).results, INK, page=page_file, images=images)
    text = page_file.read_text()
    links = re.findall(r"!\[[^]]*\]\((?!images/results/house-)([^)]*)\)", text)
    assert {page_file.parent / link for link in links} == set(pictures)
    assert "No results yet." not in text
    for path in pictures:
        assert path.stat().st_size <= MOST_BYTES
        assert len(np.unique(np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3), axis=0)) > 5


def test_a_part_of_a_page_has_marks_and_pictures_of_its_own(tmp_path: Path) -> None:
    save_results(tmp_path / "ltvn-20.trial.json", a_trial(plan=False))
    page_file = tmp_path / "results.md"
    page_file.write_text(
        "".join(
            f"<!-- {name}: begin -->\n<!-- {name}: end -->\n"
            for name in ("main", "house-main", "house-causes-pictures")
        )
    )
    house = Report(folder=tmp_path, output=tmp_path / "report.html", page=page_file, images=tmp_path, section="house")
    made = house.run()
    assert isinstance(made, Reported)
    assert [path.name for path in made.pictures] == ["house-causes.png"]
    first, second = page_file.read_text().split("<!-- main: end -->")
    assert "tune-1" not in first
    assert "tune-1" in second
    with pytest.raises(OptionError, match="flat-main"):
        replace(house, section="flat").run()


def test_the_page_in_the_repository_has_every_block() -> None:
    text = PAGE.read_text()
    for name in [*tables_of(Results()), *(f"{kind}-pictures" for kind in KINDS)]:
        assert text.count(f"<!-- {name}: begin -->") == text.count(f"<!-- {name}: end -->") == 1
