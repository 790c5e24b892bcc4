"""Rows stay what they were put as, in memory and in a file."""

import numpy as np
import pytest

from ltvn_core.graph import feature_rows
from ltvn_core.graph.feature_rows import FeatureRows


@pytest.mark.parametrize("most", [0, 2**20], ids=["in a file", "in memory"])
def test_rows_are_kept_while_more_come_and_others_are_replaced(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feature_rows, "MOST_IN_MEMORY", most)
    wanted = np.random.default_rng(0).normal(size=(300, 7)).astype(np.float16)
    rows = FeatureRows(wanted[0])
    for place, row in enumerate(wanted):
        rows.put(place, row)
    np.testing.assert_array_equal(rows.array[:300], wanted)
    rows.put(5, wanted[0])
    np.testing.assert_array_equal(rows.array[[5, 6]], wanted[[0, 6]])


def test_rows_of_objects_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feature_rows, "MOST_IN_MEMORY", 0)
    rows = FeatureRows(np.array(["a"], object))
    for place in range(100):
        rows.put(place, np.array([str(place)], object))
    assert rows.array[99, 0] == "99"
