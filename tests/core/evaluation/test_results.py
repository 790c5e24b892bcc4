"""Drawings of maps lie beside the results: small, and the same after reading."""

import json
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.map_drawing import MapDrawing, load_drawing, save_drawing
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.results import RunColumns, columns_line, drawing_path, read_queries, read_runs
from ltvn_core.evaluation.worlds.world_metrics import world_metrics
from tests.core.evaluation.reports.fake_results import make_floorplan
from tests.repository import ROOT

EMPTY = MapDrawing(origin=(0.0, 0.0), resolution_m=0.05, free=(), nodes=(), edges=())


def test_a_drawing_is_read_as_it_was_written_to_the_millimetre(tmp_path: Path) -> None:
    drawing = make_floorplan(nodes=90, spurious=3, rng=np.random.default_rng(0))
    save_drawing(tmp_path / "map.npz", drawing)
    read = load_drawing(tmp_path / "map.npz")

    assert (read.origin, read.resolution_m, read.free) == (drawing.origin, drawing.resolution_m, drawing.free)
    assert np.array(read.nodes) == pytest.approx(np.array(sorted(drawing.nodes)), abs=0.0006)
    assert np.array(read.edges) == pytest.approx(np.array(sorted(drawing.edges)), abs=0.0006)


def test_a_drawing_of_an_empty_map_can_be_kept_too(tmp_path: Path) -> None:
    save_drawing(tmp_path / "map.npz", EMPTY)

    assert load_drawing(tmp_path / "map.npz") == EMPTY


def test_a_drawing_takes_a_few_kilobytes(tmp_path: Path) -> None:
    save_drawing(tmp_path / "map.npz", make_floorplan(nodes=500, spurious=10, rng=np.random.default_rng(0)))

    assert (tmp_path / "map.npz").stat().st_size < 15_000


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"no drawing"])
def test_a_broken_drawing_is_named(tmp_path: Path, content: bytes) -> None:
    path = drawing_path(tmp_path, 100)
    path.write_bytes(content)

    with pytest.raises(OptionError, match=r"map-0100\.npz is not a drawing"):
        load_drawing(path)


MEASURED = ROOT / "docs/measurements"


def test_stored_results_of_all_kinds_are_read() -> None:
    (static,) = read_runs([MEASURED / "evaluation/apartment-70-0/ltvn/rows.jsonl.gz"])
    (lifelong,) = read_runs([MEASURED / "house/aws_small_house-0/ltvn-lifelong/rows.jsonl.gz"])
    world_file = MEASURED / "changing/apartment-70-0/ltvn-persistent-doors-50-in-0.5-days/rows.jsonl.gz"
    (world,) = read_runs([world_file])
    episodes = static.maps[0].episodes
    assert [episode.query for episode in episodes] == list(range(25))
    assert all(episode.spl > 0 for episode in episodes if episode.reached)
    assert [query.query for query in lifelong.queries] == list(range(50))
    assert lifelong.queries[-1].nodes > 0
    assert world_metrics([world]).brier > 0


def test_a_line_has_the_columns_of_its_run_and_none_that_nobody_filled() -> None:
    columns = RunColumns(
        scene="demo", seed=3, method="ltvn", preset="robust", finetuned=True, predictor="network", world="doors", days=2
    )
    row = QueryResult(query=0, reached=True, outcome="arrived", at_s=90_000.0, doors_used=(1,))
    line = json.loads(columns_line(columns, row))
    assert (line["scene"], line["seed"], line["world"], line["day"], line["query"]) == ("demo", 3, "doors", 2, 0)
    assert "yaw_error_rad" not in line


def test_a_column_that_no_version_had_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").write_text('{"query":1,"reached":true,"fate":"arrived"}', encoding="utf-8")
    with pytest.raises(OptionError, match=r"rows\.jsonl"):
        read_queries(tmp_path / "rows.jsonl")
