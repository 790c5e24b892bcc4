"""A few of the mutations of which the campaigns try thousands."""

from pathlib import Path

from tests.core.data.recording import example_recording
from tests.core.data.recording.mutations import Fate, judge_mutations
from tests.platforms import needs_posix
from tests.repository import GOLDEN_RECORDING


@needs_posix
def test_mutations_are_noticed_end_no_process_and_cost_only_what_they_hit(tmp_path: Path) -> None:
    whole = tmp_path / "drive.rrd"
    example_recording.write(whole, frames=10)
    judgements = list(judge_mutations(whole, seed=1, count=20))
    assert [judged for judged in judgements if judged.fate is not Fate.REFUSED] == []
    assert len(judgements) == 20
    assert sum(judged.recovered for judged in judgements) >= 0.99 * sum(judged.undamaged for judged in judgements)


def test_mutations_of_an_older_recording_end_no_process() -> None:
    judgements = list(judge_mutations(GOLDEN_RECORDING, seed=2, count=2))
    assert [judged for judged in judgements if judged.fate not in (Fate.REFUSED, Fate.ACCEPTED)] == []
    assert sum(judged.recovered for judged in judgements) >= 0.9 * sum(judged.undamaged for judged in judgements)
