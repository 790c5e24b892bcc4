"""Whatever a program calls, the server answers, writes nothing and goes on."""

from pathlib import Path
from random import Random

from tests.viz.agent.called_tools import harmless_agent, judge_call

CALLS = 100
SEED = 38


def test_calls_of_every_kind_write_nothing_and_end_nothing(tmp_path: Path) -> None:
    random = Random(SEED)

    with harmless_agent(tmp_path) as agent:
        complaints = [complaint for _ in range(CALLS) if (complaint := judge_call(agent, random))]

    assert complaints == []
