"""The whole main job without a browser, as the README promises it: collect, build, navigate, record."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ltvn_core.data.recording.integrity import verify
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.navigation.events import Judged
from tests.core.simulation.two_room_mesh import box_house, save

pytestmark = pytest.mark.slow

for library in ("embreex", "torch"):
    pytest.importorskip(library)

KEYS = {"frames", "nodes", "edges", "queries", "reached", "collisions", "pruned", "added", "recording", "wall_s"}


def test_the_demo_reaches_its_goals_and_its_recording_tells_all(tmp_path: Path) -> None:
    summary = demonstrate(tmp_path, queries=3)
    assert summary.keys() >= KEYS
    assert summary["queries"] == 3
    assert summary["reached"] >= 2
    verify(tmp_path / "drive.rrd")
    recording = Recording.open(tmp_path / "drive.rrd")
    assert recording.final_graph() == load_map(tmp_path / "map.rrd").graph
    verdicts = [stamped.event for stamped in recording.events if isinstance(stamped.event, Judged)]
    assert sum(verdict.reached for verdict in verdicts) == summary["reached"]


def demonstrate(folder: Path, *, queries: int) -> dict[str, Any]:
    """Run the README's command with a shorter tour of a small house, and return what it says."""
    house = save(box_house(), folder / "house.glb")
    options = ["--headless", "--queries", str(queries), "--loops", "1", "--seed", "7", "--json", "-"]
    files = ["--scene", str(house), "--recording", str(folder / "drive.rrd"), "--map", str(folder / "map.rrd")]
    run = subprocess.run(
        [sys.executable, "-m", "ltvn_core.cli", "demo", *options, *files], capture_output=True, text=True, check=True
    )
    return json.loads(run.stdout)
