"""Rows of queries are written without empty columns, and those of older files are still read."""

from pathlib import Path

import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import QueryBatch, QueryResult, append_to_log, read_query_log
from ltvn_core.evaluation.results import LifelongResult, TrialResult, WorldResult, load_results, save_results
from ltvn_core.evaluation.worlds.world_metrics import world_metrics
from tests.repository import ROOT

MEASURED = ROOT / "docs/measurements"

OLD_EPISODES = """{"episodes":[{"episode":7,"start":6848,"goal":4331,"reached":true,"outcome":"arrived","failure":null,
"trigger":null,"steps":165,"collisions":0,"path_m":4.0,"shortest_m":2.0,"position_error_m":0.048,
"yaw_error_rad":0.065}],"wall_s":3.5}"""
OLD_ROBOT_LINE = (
    '{"phase": "queries", "number": 3, "goal": 14, "outcome": "arrived", "reached": true, "judged_by": "truth", '
    '"away_m": 0.2, "path_m": 4.5, "seconds": 31.0, "pruned": 1, "added": 4}'
)


def test_an_older_batch_of_episodes_is_read(tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(OLD_EPISODES, encoding="utf-8")
    batch: QueryBatch = load_results(tmp_path / "old.json", QueryBatch)
    (result,) = batch.queries
    assert (result.query, result.goal, result.spl, batch.wall_s) == (7, 4331, 0.5, 3.5)


def test_an_older_line_of_a_robot_is_read(tmp_path: Path) -> None:
    (tmp_path / "episodes.jsonl").write_text(OLD_ROBOT_LINE + "\n", encoding="utf-8")
    append_to_log(tmp_path / "episodes.jsonl", QueryResult(query=4, phase="queries", reached=False, outcome="lost"))
    old, new = read_query_log(tmp_path / "episodes.jsonl")
    assert (old.query, old.phase, old.position_error_m, old.pruned, old.added_edges) == (3, "queries", 0.2, 1, 4)
    assert (new.query, new.reached) == (4, False)


def test_older_results_of_all_kinds_are_read() -> None:
    trial: TrialResult = load_results(MEASURED / "evaluation/apartment-70-0/ltvn-25.trial.json", TrialResult)
    (lifelong_file,) = (MEASURED / "house/aws_small_house-0").glob("*.lifelong.json.gz")
    lifelong: LifelongResult = load_results(lifelong_file, LifelongResult)
    world_file = next(MEASURED.glob("changing/apartment-70-0/ltvn/*/persistent.world.json.gz"))
    world: WorldResult = load_results(world_file, WorldResult)
    assert [episode.query for episode in trial.episodes] == list(range(25))
    assert all(episode.spl > 0 for episode in trial.episodes if episode.reached)
    assert [query.query for query in lifelong.queries] == list(range(50))
    assert lifelong.queries[-1].nodes > 0
    assert world_metrics([world]).brier > 0


def test_a_row_is_written_without_the_columns_that_nobody_filled(tmp_path: Path) -> None:
    rows = QueryBatch((QueryResult(query=0, reached=True, outcome="arrived", doors_used=(1,)),), 1.0)
    save_results(tmp_path / "rows.json", rows)
    assert "yaw_error_rad" not in (tmp_path / "rows.json").read_text(encoding="utf-8")
    assert load_results(tmp_path / "rows.json", QueryBatch) == rows


def test_a_column_that_no_version_had_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(OLD_EPISODES.replace("outcome", "fate"), encoding="utf-8")
    with pytest.raises(OptionError, match="QueryBatch"):
        load_results(tmp_path / "rows.json", QueryBatch)
