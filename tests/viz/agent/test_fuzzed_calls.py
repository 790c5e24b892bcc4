"""Whatever a program calls, the server answers, writes nothing, goes on, and has no part that drives or records."""

import json
import subprocess
import sys
from pathlib import Path
from random import Random

from tests.repository import ROOT
from tests.viz.agent.called_tools import harmless_agent, judge_call

CALLS = 60
SEED = 38


def test_calls_of_every_kind_write_nothing_and_end_nothing(tmp_path: Path) -> None:
    random = Random(SEED)
    with harmless_agent(tmp_path) as agent:
        complaints = [complaint for _ in range(CALLS) if (complaint := judge_call(agent, random))]
    assert complaints == []


_MUST_NOT_BE_LOADED = ("ltvn_core.robots.robot_plugins", "ltvn_core.robots.ros2", "ltvn_viz.session.session_loop")
"""What opens a robot, and what leads a session."""
_SERVE = """
import gc, json, sys
from pathlib import Path
from random import Random
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_viz.agent.named_files import NamedFiles
from ltvn_viz.agent.tools import RecordingTools
from ltvn_viz.session.live_run import LiveRun
from tests.repository import RECORDINGS
from tests.viz.agent.called_tools import FILES, draw_call

tools = RecordingTools(NamedFiles([RECORDINGS / name for name in FILES]))
random = Random(38)
for _ in range(20):
    tools.call(*draw_call(random))
driving = [type(each).__name__ for each in gc.get_objects() if type(each) in (SimulatedRobot, LiveRun, RecordingWriter)]
print(json.dumps({"calls": tools.calls, "refused": tools.refused, "loaded": [*sys.modules], "driving": driving}))
"""


def test_calls_of_every_kind_load_and_make_nothing_that_drives() -> None:
    served = subprocess.run(
        [sys.executable, "-c", _SERVE], cwd=ROOT, capture_output=True, text=True, check=True, timeout=300
    )
    found = json.loads(served.stdout.splitlines()[-1])
    assert found["refused"] < found["calls"] == 20  # Many were answered.
    assert found["driving"] == []
    assert not set(_MUST_NOT_BE_LOADED) & set(found["loaded"])
