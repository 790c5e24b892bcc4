"""Places recognised again are counted against a matrix of loop closures."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from ltvn_core.errors import DatasetError
from ltvn_core.evaluation.predictor_accuracy.revisits import read_revisits, revisit_accuracy, summarise_revisits
from tests.core.flat_world import FlatPredictor, observation_at, one_room
from tests.platforms import needs_posix


@pytest.fixture
def two_rounds() -> np.ndarray:
    """Forty images, the second twenty at the places of the first."""
    matrix = np.zeros((40, 40), bool)
    matrix[np.arange(20, 40), np.arange(20)] = True
    return matrix


@pytest.mark.parametrize("name", ["matrix.txt", "matrix.csv", "matrix.bmp"])
def test_a_matrix_is_read_from_text_and_from_a_picture(name: str, two_rounds: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / name
    if path.suffix == ".bmp":
        cv2.imwrite(str(path), two_rounds.astype(np.uint8) * 255)
    else:
        np.savetxt(path, two_rounds, "%d", delimiter="," if path.suffix == ".csv" else " ", header="who shows what")
    np.testing.assert_array_equal(read_revisits(path, 40), two_rounds | two_rounds.T)


def test_a_matrix_of_another_size_or_of_no_numbers_is_refused(two_rounds: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "matrix.txt"
    np.savetxt(path, two_rounds, "%d")
    with pytest.raises(DatasetError, match="must be a matrix of 41 x 41 numbers"):
        read_revisits(path, 41)
    path.write_text("yes no\nno yes\n", encoding="utf-8")
    with pytest.raises(DatasetError, match="cannot be read as a loop-closure matrix"):
        read_revisits(path, 2)
    with pytest.raises(DatasetError, match="cannot be read"):
        read_revisits(tmp_path / "nothing.png", 2)


@needs_posix
@pytest.mark.parametrize("name", ["matrix.txt", "matrix.png"])
def test_a_matrix_that_would_never_end_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(DatasetError, match="is a pipe or a device"):
        read_revisits(tmp_path / name, 4)


def test_a_predictor_that_knows_the_places_recognises_them_all(two_rounds: np.ndarray) -> None:
    places = np.column_stack([np.linspace(0.5, 4.5, 20), np.full(20, 1.0), np.zeros(20)])
    predictor = FlatPredictor(one_room(), sight_m=0.1)
    features = predictor.encode([observation_at(pose, k) for k, pose in enumerate([*places, *places])])
    found = revisit_accuracy(predictor, features, two_rounds | two_rounds.T, progress=lambda done: None)
    assert found.queries == 20
    assert found.recall_at_1 == found.recall_at_full_precision == found.average_precision == found.auc == 1


def test_what_is_surest_and_wrong_cuts_off_all_that_is_less_sure(two_rounds: np.ndarray) -> None:
    score = np.where(np.tril(np.ones((40, 40)), -15) > 0, 0.1, -1.0)
    score[np.arange(20, 40), np.arange(20)] = np.linspace(0.5, 0.9, 20)
    score[19, 0] = 0.7
    found = summarise_revisits(score, two_rounds)
    assert found.recall_at_1 == 1
    assert found.recall_at_full_precision == 0.5


def test_a_drive_that_never_comes_back_has_nothing_to_recognise() -> None:
    with pytest.raises(DatasetError, match="nothing to recognise"):
        summarise_revisits(np.zeros((20, 20)), np.eye(20, dtype=bool) & False)
