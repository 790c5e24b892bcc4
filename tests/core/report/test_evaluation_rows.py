"""Results are gathered into rows and courses, and no episode or edge is lost or counted twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.evaluate.results import Failure, Results, TrialResult
from ltvn_core.report.evaluation_courses import calibration_error, calibration_of, courses_of, ends, stretches
from ltvn_core.report.evaluation_gallery import GalleryRow, chosen
from ltvn_core.report.evaluation_page import headline
from ltvn_core.report.evaluation_rows import methods_of, rows_of, rows_over_scenes, setup_of
from ltvn_core.report.evaluation_tables import Table, main_table, margin_table
from tests.core.report.found import a_few, a_lifelong, a_trial


@pytest.fixture(scope="module")
def results() -> Results:
    return a_few()


def test_a_row_gathers_the_seeds_of_one_setup_and_fine_tuning_is_a_stage_of_the_same_method(results: Results) -> None:
    rows = rows_of(results.trials)
    assert [(row.setup.scene, row.setup.method, row.setup.finetuned, row.seeds) for row in rows] == [
        ("tune-1", "LTVN robust", False, (0,)),
        ("tune-1", "LTVN robust", True, (0, 1)),
        ("tune-1", "SPTM", True, (0, 1)),
        ("tune-2", "LTVN robust", True, (0, 1)),
        ("tune-2", "SPTM", True, (0, 1)),
    ]
    reached = [episode.reached for trial in rows[1].trials for episode in trial.episodes]
    assert rows[1].success.mean == pytest.approx(np.mean(reached))
    assert sum(map(rows[1].failed, Failure)) == pytest.approx(1 - np.mean(reached))


def test_only_methods_of_all_scenes_have_a_mean_over_all_scenes(results: Results) -> None:
    whole = rows_over_scenes(rows_of(results.trials))
    assert [(row.setup.method, row.setup.finetuned, len(row.trials)) for row in whole] == [
        ("LTVN robust", True, 4),
        ("SPTM", True, 4),
    ]
    assert main_table(rows_of(results.trials)).rows[0][0] == "all scenes"


def test_what_a_method_is_called_says_what_was_switched_off() -> None:
    named = [
        a_trial(),
        a_trial(preset="paper"),
        a_trial(without=("expansion", "fine-tuning"), finetuned=False),
        replace(a_trial(), fingerprint="oracle"),
        a_trial(method="sptm"),
        a_trial(method="ving", preset="paper"),
    ]
    assert methods_of(rows_of(reversed(named))) == (
        "LTVN robust",
        "LTVN paper",
        "LTVN robust with the oracle",
        "LTVN robust without expansion",
        "SPTM",
        "ViNG, paper navigator",
    )
    assert [setup_of(trial).ablated for trial in named] == [False, False, True, True, False, False]


def test_the_margin_over_a_rival_is_the_difference_of_their_successes(results: Results) -> None:
    rows = rows_of(results.trials)
    ours, theirs = rows_over_scenes(rows)
    (line,) = margin_table(rows).rows
    assert line[:2] == ("LTVN robust", "SPTM")
    assert line[3].startswith(f"{100 * (ours.success.mean - theirs.success.mean):+.1f} points")
    assert line[5] == f"{100 * ours.figures.nodes / theirs.figures.nodes:.1f} %"
    assert f"LTVN robust {100 * ours.success.mean:.0f} %" in headline(rows)


def test_a_stretch_is_the_mean_of_what_its_queries_did() -> None:
    (course,) = courses_of([a_lifelong(seed=0, points=3), a_lifelong(seed=1, points=3)])
    first, second = stretches(course)
    assert (first.until, second.until) == (100, 200)
    total = sum(query.pruned for run in course.runs for query in run.queries)
    assert first.pruned + second.pruned == pytest.approx(total / 2)
    assert first.pruned_bad <= first.pruned


def test_calibration_is_added_up_edge_by_edge() -> None:
    courses = courses_of([a_lifelong(seed=0), a_lifelong(seed=1)])
    cells = calibration_of(ends(courses, last=True))
    everything = [cell for run in courses[0].runs for cell in run.points[-1].calibration]
    assert sum(cell.edges for cell in cells) == sum(cell.edges for cell in everything)
    drivable = sum(cell.edges * cell.drivable for cell in everything)
    assert sum(cell.edges * cell.drivable for cell in cells) == pytest.approx(drivable)
    assert 0 <= calibration_error(cells) <= 1
    assert np.isnan(calibration_error([]))


def a_failure(trial: TrialResult, number: int, cause: Failure) -> GalleryRow:
    return GalleryRow(trial, replace(trial.episodes[0], episode=number, reached=False, failure=cause))


def test_the_gallery_takes_each_cause_in_turn_and_recorded_ones_first(tmp_path: Path) -> None:
    trial = a_trial()
    often = [a_failure(trial, number, Failure.COLLISION) for number in range(50)]
    recorded = replace(a_failure(trial, 50, Failure.COLLISION), recording=tmp_path / "a.rrd")
    rare = a_failure(trial, 51, Failure.NO_PATH)
    shown = chosen([*often, recorded, rare], 3)
    assert [row.episode.episode for row in shown] == [50, 51, 0]


def test_an_empty_table_says_so() -> None:
    assert Table("", ("a", "b"), (), 1).markdown() == "No results yet."
    assert Table("", ("a", "b"), (("x|y", "1"),), 1).markdown() == "| a | b |\n| --- | ---: |\n| x\\|y | 1 |"
