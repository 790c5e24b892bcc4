"""A program that works by a language model calls whatever it likes: nothing is written, and the server goes on."""

import time
from pathlib import Path
from random import Random

import psutil
import pytest

from tests.campaigns.tally import Tally
from tests.viz.agent.called_tools import harmless_agent, judge_call

SEED = 39


@pytest.mark.campaign(asked=10_000, share=0.06)
def test_agent_calls(tally: Tally, tmp_path: Path) -> None:
    random = Random(SEED)
    known = {child.pid for child in psutil.Process().children()}
    with harmless_agent(tmp_path) as agent:
        (server,) = (child for child in psutil.Process().children() if child.pid not in known)
        for _ in tally.batches():
            called_s = time.monotonic()
            if complaint := judge_call(agent, random):
                tally.fail(complaint)
            tally.add(1)
            tally.most(longest_call_s=time.monotonic() - called_s, rss_mb=server.memory_info().rss / 1e6)
    assert tally.failures == []
