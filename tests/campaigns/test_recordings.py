"""Recordings under attack: killed processes, failing disks and damaged bytes, as often as time allows."""

from pathlib import Path

import numpy as np
import pytest

from tests.campaigns.tally import Tally
from tests.campaigns.written_ways import WAYS
from tests.core.data.recording.disk_faults import FAULTS, kill_while_recording, may_mount, strike
from tests.core.data.recording.mutations import Fate, judge_mutations
from tests.core.data.recording.test_disk_faults import LOST_S, lost_by, require_said_and_kept

SEED = 14
SIDE_BY_SIDE = 2
PER_PROCESS = 20
"""Mutations that one process judges: Rerun keeps some threads for each file that it ever wrote."""


@pytest.mark.campaign(asked=300, share=0.2)
def test_kills(tally: Tally, tmp_path: Path) -> None:
    def kill(numbers: range) -> None:
        folder = tmp_path / str(numbers[0])
        steps = int(np.random.default_rng([SEED, numbers[0]]).integers(1, 150))
        killed = kill_while_recording(folder / "killed.rrd", steps_before=steps)
        tally.add(1)
        lost_s = lost_by(killed, folder / "repaired.rrd")
        tally.most(longest_loss_s=lost_s)
        assert lost_s <= LOST_S, f"{lost_s} s lost after {steps} steps"

    tally.spread(kill, side_by_side=SIDE_BY_SIDE)
    assert tally.failures == []


@pytest.mark.campaign(asked=20, share=0.09)
def test_disk_faults(tally: Tally, tmp_path: Path) -> None:
    mountable = may_mount(tmp_path / "probe")
    names = [name for name, fault in FAULTS.items() if mountable or not fault.needs_mount]
    tally.add(kinds=len(names))

    def fail(numbers: range) -> None:
        folder, name = tmp_path / str(numbers[0]), names[numbers[0] % len(names)]
        steps = int(np.random.default_rng([SEED, numbers[0]]).integers(60, 150))
        with strike(FAULTS[name], folder, steps_before=steps) as outcome:
            tally.add(1)
            tally.most(longest_end_s=outcome.ended_after_s)
            if not FAULTS[name].comes_later:
                tally.most(longest_until_told_s=outcome.told_after_s)
            require_said_and_kept(outcome, name, folder / "repaired.rrd")

    tally.spread(fail)
    assert tally.failures == []


@pytest.mark.campaign(asked=2000, share=0.24)
def test_mutations(tally: Tally, tmp_path: Path) -> None:
    files = [tmp_path / f"{name.replace(' ', '-')}.rrd" for name in WAYS]
    for write, path in zip(WAYS.values(), files, strict=True):
        write(path)
    tally.add(ways=len(files))

    def mutate(numbers: range) -> None:
        path = files[numbers[0] // PER_PROCESS % len(files)]
        for judged in judge_mutations(path, seed=SEED, first=numbers.start, count=numbers.stop):
            tally.add(1, **{judged.fate.value: 1})
            tally.add(undamaged=judged.undamaged, recovered=judged.recovered, frames=judged.frames, saved=judged.saved)
            lost_one = judged.recovered < judged.undamaged and judged.is_one_bit
            if judged.fate not in (Fate.REFUSED, Fate.HARMLESS) or lost_one:
                tally.fail(f"{path.stem}: {judged}")
            if tally.is_over:
                break

    tally.spread(mutate, batch=PER_PROCESS, side_by_side=SIDE_BY_SIDE)
    assert tally.failures == []
    assert tally.findings["recovered"] >= 0.99 * tally.findings["undamaged"]
