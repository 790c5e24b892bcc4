"""Damaged files, new and old: noticed, read without danger to the program, and saved message by message."""

from pathlib import Path

import pytest

from tests.core.recording import example_recording
from tests.core.recording.mutations import Fate, judge_mutations


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "drive.rrd"
    example_recording.write(path, frames=40)
    return path


def test_mutations_are_noticed_end_no_process_and_cost_only_what_they_hit(whole: Path) -> None:
    judgements = list(judge_mutations(whole, seed=1, count=60))
    wrong = [judged for judged in judgements if judged.fate is not Fate.REFUSED]
    assert not wrong
    assert len(judgements) == 60
    assert sum(judged.recovered for judged in judgements) >= 0.99 * sum(judged.undamaged for judged in judgements)
