"""Drives of other programs with damage in them, imported as often as time allows."""

from pathlib import Path

import pytest

from tests.campaigns.tally import Tally
from tests.core.data.importing.mutations import Fate, judge_mutations
from tests.core.data.importing.test_mutated_drives import write_drives

SEED = 21
PER_PROCESS = 50


@pytest.mark.campaign(asked=3000, share=0.1)
def test_mutated_drives(tally: Tally, tmp_path: Path) -> None:
    drives = write_drives(tmp_path / "drives")
    tally.add(formats=len(list(drives.iterdir())))

    def mutate(numbers: range) -> None:
        scratch = tmp_path / f"scratch-{numbers[0]}"
        for judged in judge_mutations(drives, scratch, seed=SEED, first=numbers.start, count=len(numbers)):
            tally.add(1, **{judged.fate.value: 1})
            if judged.fate not in (Fate.IMPORTED, Fate.REFUSED):
                tally.fail(f"{judged}")
            if tally.is_over:
                break

    tally.spread(mutate, batch=PER_PROCESS, side_by_side=2)
    assert tally.failures == []
