"""Everything that simulates runs where PyBullet cannot be imported, as on most platforms."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ltvn_core.data.recording.reader import Recording
from tests.core.simulation.two_room_mesh import box_house, save
from tests.repository import ROOT
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.slow

for library in ("embreex", "torch"):
    pytest.importorskip(library)

WITHOUT_PYBULLET = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name == "pybullet":
            raise ModuleNotFoundError("No module named 'pybullet'", name=name)

sys.meta_path.insert(0, Refuse())
"""

APP = """
import threading
from ltvn_viz.app import AppOptions, open_app
from tests.waiting import until

def watch(app):
    robot = app.session.state.live.robot
    before = robot.state().stamp
    until(lambda: robot.state().stamp > before + 0.5)
    print("time goes on", flush=True)
    app.session.stop()

with open_app(AppOptions(port=0)) as app:
    threading.Thread(target=watch, args=[app]).start()
    app.session.run()
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return an environment whose Python processes, and those that they start, cannot import PyBullet."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text(WITHOUT_PYBULLET)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a scene of two small rooms."""
    return str(save(box_house(), tmp_path_factory.mktemp("house") / "house.glb"))


def ltvn(environment: dict[str, str], *arguments: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "ltvn_core.cli", *arguments],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=2 * PATIENCE_S,
    )


def summary(environment: dict[str, str], *arguments: str) -> dict[str, Any]:
    done = ltvn(environment, *arguments, "--json", "-")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("planar") <= 1
    return json.loads(done.stdout)


def test_a_tour_is_collected_and_names_its_body(environment: dict[str, str], house: str, tmp_path: Path) -> None:
    drive = tmp_path / "drive.rrd"
    told = summary(environment, "collect", "--scene", house, "--loops", "1", "--output", str(drive))
    assert told["frames"] > 10
    assert Recording.open(drive).meta.config["body"] == "planar"


def test_bullet_is_refused_with_a_line_that_names_what_runs(environment: dict[str, str], tmp_path: Path) -> None:
    done = ltvn(environment, "collect", "--body", "bullet", "--output", str(tmp_path / "never.rrd"))
    assert done.returncode == 1
    assert "--body planar" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "never.rrd").exists()


def test_the_headless_demo_runs(environment: dict[str, str], house: str, tmp_path: Path) -> None:
    options = ("--scene", house, "--queries", "1", "--loops", "1", "--recording", str(tmp_path / "demo.rrd"))
    told = summary(environment, "demo", "--headless", *options)
    assert told["queries"] == 1


def test_an_evaluation_runs_and_does_not_go_on_from_one_with_another_body(
    environment: dict[str, str], house: str, tmp_path: Path
) -> None:
    smallest = ("--scene", house, "--loops", "1", "--goals", "2", "--episodes", "1", "--finetune-steps", "0")
    command = ("evaluate", *smallest, "--step-limit", "50", "--processes", "1", "--folder", str(tmp_path))
    assert summary(environment, *command)["episodes"] == 1
    plan = json.loads(next(tmp_path.glob("*/ltvn/plan.json")).read_text())
    assert plan["protocol"]["body"] == "planar"
    pytest.importorskip("pybullet")
    refused = ltvn({**os.environ, "PYTHONPATH": str(ROOT)}, *command)
    assert refused.returncode == 1
    assert "body" in refused.stderr or "protocol" in refused.stderr


def test_a_robot_of_ros_2_is_served(environment: dict[str, str]) -> None:
    pytest.importorskip("zenoh")
    served = subprocess.Popen(
        [sys.executable, "-m", "ltvn_core.cli", "serve", "--listen", "tcp/127.0.0.1:0"],
        env=environment,
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert served.stderr is not None
        lines = []
        while "Serving" not in (line := served.stderr.readline()):
            assert line, "".join(lines)
            lines.append(line)
        assert any("planar" in each for each in lines)
    finally:
        served.kill()
        served.communicate()


def test_the_page_opens_and_its_robot_moves_in_time(environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", APP], env=environment, cwd=ROOT, capture_output=True, text=True, timeout=2 * PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("time goes on\n")
