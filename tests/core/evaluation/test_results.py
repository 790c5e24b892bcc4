"""Drawings of maps lie beside the results: small, and the same after reading."""

from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import OptionError
from ltvn_core.evaluation.map_drawing import MapDrawing, load_drawing, save_drawing
from ltvn_core.evaluation.results import drawing_path
from tests.core.evaluation.reports.fake_results import make_floorplan

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
