"""An interrupted build goes on from the answers that were kept, and gives the map of an uninterrupted one."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import pytest

from ltvn_core.graph.builder import ProgressCallback
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.maps.topological_map import build_map
from ltvn_core.predictors.remembered_answers import RememberedPredictor
from tests.core.flat_world import FlatPredictor, one_room, tour

WAY = ((1.0, 1.0), (4.0, 1.0), (4.0, 3.0), (1.0, 3.0))


def built(
    answers: Path | None,
    progress: ProgressCallback = lambda _done, _total: None,
    way: Sequence[tuple[float, float]] = WAY,
) -> tuple[tuple[GraphDelta, ...], int]:
    """Build a map; return its contents, and how many pairs the predictor had to compare."""
    predictor = FlatPredictor(one_room())
    with nullcontext(predictor) if answers is None else RememberedPredictor(predictor, answers) as asked:
        graph = build_map(list(tour(way)), predictor=asked, progress=progress).graph
    return graph.deltas(), predictor.compared


def interrupt(answers: Path, share: float = 0.6) -> None:
    """Interrupt a build after a share of its images."""

    def progress(done: int, total: int) -> None:
        if done > share * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        built(answers, progress)


def untouched(data: bytes) -> bytes:
    return data


@pytest.mark.parametrize(
    "damage",
    [untouched, lambda data: data[:-7], lambda data: data[: len(data) // 2] + b"?" + data[len(data) // 2 + 1 :]],
    ids=["as it was left", "cut off by the kill", "a byte changed"],
)
def test_an_interrupted_build_goes_on_to_the_same_map(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    whole, comparisons = built(None)
    answers = tmp_path / "map.rrd.unfinished"
    interrupt(answers)
    answers.write_bytes(damage(answers.read_bytes()))
    again, fewer = built(answers)
    assert again == whole
    assert 0 < fewer < comparisons


def test_the_answers_of_another_drive_are_not_used(tmp_path: Path) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    interrupt(answers)
    there = ((2.0, 1.0), (4.5, 1.0), (4.5, 2.5))
    assert built(answers, way=there) == built(None, way=there)


def test_a_finished_build_asks_nothing_again(tmp_path: Path) -> None:
    answers = tmp_path / "map.rrd.unfinished"
    whole, _ = built(answers)
    assert built(answers) == (whole, 0)


def test_a_build_whose_answers_cannot_be_kept_goes_on_without_them(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert built(tmp_path / "file" / "map.rrd.unfinished") == built(None)


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    answers = tmp_path / "new" / "folder" / "map.rrd.unfinished"
    assert built(answers) == built(None)
    assert answers.exists()
