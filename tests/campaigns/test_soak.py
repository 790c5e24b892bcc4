"""The real app for a short while: it navigates, records, keeps its memory, and leaves whole recordings."""

import time
from pathlib import Path

import pytest

from benchmarks.soak import soak
from ltvn_core.data.recording.integrity import verify
from tests.campaigns.tally import Tally

GROWTH = 1.1
"""More than this in the second half of so short a run would be a leak; the hour-long benchmark tells finer."""


@pytest.mark.campaign(asked=60, share=0.07)
def test_soak_seconds(tally: Tally, tmp_path: Path) -> None:
    minutes = min(tally.asked, max(1.0, tally.ends_s - time.monotonic())) / 60
    samples = list(soak(tmp_path, minutes, seed=0))
    tally.add(round(60 * samples[-1].minute), queries=samples[-1].queries, recorded_mb=samples[-1].recorded_mb)
    tally.most(rss_mb=samples[-1].rss_mb)
    recordings = list(tmp_path.rglob("*.rrd"))
    assert recordings
    for recording in recordings:
        verify(recording)
    settled = samples[len(samples) // 2]
    assert samples[-1].rss_mb <= GROWTH * settled.rss_mb
