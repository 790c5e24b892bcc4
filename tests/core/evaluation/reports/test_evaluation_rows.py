"""Results are gathered into rows and courses, and no episode or edge is lost or counted twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.evaluation.reports.evaluation_page import headline
from ltvn_core.evaluation.reports.evaluation_tables import ReportTable, main_table, margin_table
from ltvn_core.evaluation.reports.failure_gallery import FailureRow, select_failures
from ltvn_core.evaluation.reports.result_rows import (
    calibration_error,
    calibration_of,
    end_points,
    group_lifelong,
    maintenance_intervals,
    methods_of,
    rows_of,
    rows_over_scenes,
    setup_of,
)
from ltvn_core.evaluation.results import Run, TestedMap
from tests.core.evaluation.reports.fake_results import (
    few_results,
    make_lifelong_result,
    make_trial,
    runs_of,
    with_columns,
)


@pytest.fixture(scope="module")
def results() -> tuple[Run, ...]:
    return few_results()


def test_a_row_gathers_the_seeds_of_one_setup_and_fine_tuning_is_a_stage_of_the_same_method(
    results: tuple[Run, ...],
) -> None:
    rows = rows_of(results)
    assert [(row.setup.scene, row.setup.method, row.setup.finetuned, row.seeds) for row in rows] == [
        ("tune-1", "LTVN robust", False, (0,)),
        ("tune-1", "LTVN robust", True, (0, 1)),
        ("tune-1", "SPTM", True, (0, 1)),
        ("tune-2", "LTVN robust", True, (0, 1)),
        ("tune-2", "SPTM", True, (0, 1)),
    ]
    reached = [episode.reached for trial in rows[1].trials for episode in trial.episodes]
    assert rows[1].success.mean == pytest.approx(np.mean(reached))
    assert sum(map(rows[1].failed, FailureCause)) == pytest.approx(1 - np.mean(reached))


def test_only_methods_of_all_scenes_have_a_mean_over_all_scenes(results: tuple[Run, ...]) -> None:
    whole = rows_over_scenes(rows_of(results))
    assert [(row.setup.method, row.setup.finetuned, len(row.trials)) for row in whole] == [
        ("LTVN robust", True, 4),
        ("SPTM", True, 4),
    ]
    assert main_table(rows_of(results)).rows[0][0] == "all scenes"


def test_what_a_method_is_called_says_what_was_switched_off() -> None:
    named = [
        make_trial(),
        make_trial(preset="paper"),
        make_trial(without=("expansion", "fine-tuning"), finetuned=False),
        with_columns(make_trial(), predictor="oracle"),
        make_trial(method="sptm"),
        make_trial(method="ving", preset="paper"),
    ]
    assert methods_of(rows_of(runs_of(*reversed(named)))) == (
        "LTVN robust",
        "LTVN paper",
        "LTVN robust with the oracle",
        "LTVN robust without expansion",
        "SPTM",
        "ViNG, paper navigator",
    )
    assert [setup_of(trial).ablated for trial in named] == [False, False, True, True, False, False]


def test_the_margin_over_a_baseline_is_the_difference_of_their_successes(results: tuple[Run, ...]) -> None:
    rows = rows_of(results)
    ours, theirs = rows_over_scenes(rows)
    (line,) = margin_table(rows).rows
    assert line[:2] == ("LTVN robust", "SPTM")
    assert line[3].startswith(f"{100 * (ours.success.mean - theirs.success.mean):+.1f} points")
    assert line[5] == f"{100 * ours.metrics.nodes / theirs.metrics.nodes:.1f} %"
    assert f"LTVN robust {100 * ours.success.mean:.0f} %" in headline(rows)


def test_a_stretch_is_the_mean_of_what_its_queries_did() -> None:
    (group,) = group_lifelong([make_lifelong_result(seed=0, points=3), make_lifelong_result(seed=1, points=3)])
    first, second = maintenance_intervals(group)
    assert (first.until, second.until) == (100, 200)
    total = sum(query.pruned for run in group.runs for query in run.queries)
    assert first.pruned + second.pruned == pytest.approx(total / 2)
    assert first.pruned_bad <= first.pruned


def test_calibration_is_added_up_edge_by_edge() -> None:
    courses = group_lifelong([make_lifelong_result(seed=0), make_lifelong_result(seed=1)])
    cells = calibration_of(end_points(courses, last=True))
    everything = [cell for run in courses[0].runs for cell in run.maps[-1].calibration]
    assert sum(cell.edges for cell in cells) == sum(cell.edges for cell in everything)
    drivable = sum(cell.edges * cell.drivable for cell in everything)
    assert sum(cell.edges * cell.drivable for cell in cells) == pytest.approx(drivable)
    assert 0 <= calibration_error(cells) <= 1
    assert np.isnan(calibration_error([]))


def a_failure(trial: TestedMap, number: int, cause: FailureCause) -> FailureRow:
    return FailureRow(trial, replace(trial.episodes[0], query=number, reached=False, failure=cause))


def test_the_gallery_takes_each_cause_in_turn_and_recorded_ones_first(tmp_path: Path) -> None:
    trial = make_trial()
    often = [a_failure(trial, number, FailureCause.COLLISION) for number in range(50)]
    recorded = replace(a_failure(trial, 50, FailureCause.COLLISION), recording=tmp_path / "a.rrd")
    rare = a_failure(trial, 51, FailureCause.NO_PATH)
    shown = select_failures([*often, recorded, rare], 3)
    assert [row.episode.query for row in shown] == [50, 51, 0]


def test_an_empty_table_says_so() -> None:
    assert ReportTable("", ("a", "b"), (), 1).markdown() == "No results yet."
    assert ReportTable("", ("a", "b"), (("x|y", "1"),), 1).markdown() == "| a | b |\n| --- | ---: |\n| x\\|y | 1 |"


def test_harder_conditions_stand_behind_the_scene_and_are_never_averaged_with_others() -> None:
    trials = [
        with_columns(make_trial(scene, method, plan=False), conditions=conditions)
        for scene in ("tune-1", "tune-2")
        for method in ("ltvn", "sptm")
        for conditions in ((), ("slip", "half-light"))
    ]
    rows = rows_of(runs_of(*trials))

    assert [row.setup.scene for row in rows][::2] == [
        "tune-1",
        "tune-1, slip, half-light",
        "tune-2",
        "tune-2, slip, half-light",
    ]
    whole = rows_over_scenes(rows)
    assert [(row.setup.scene, len(row.trials)) for row in whole] == [
        ("all scenes", 2),
        ("all scenes", 2),
        ("all scenes, slip, half-light", 2),
        ("all scenes, slip, half-light", 2),
    ]
    assert [line[2] for line in margin_table(rows).rows] == ["fine-tuned", "fine-tuned, slip, half-light"]
