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
from tests.program import ltvn_here
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

ALL = """
import contextlib, io, json, sys, threading
from ltvn_core.cli import main
from ltvn_viz.app import AppOptions, open_app
from tests.waiting import until

def run(words):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    return {"code": code, "stdout": out.getvalue(), "stderr": err.getvalue()}

def watch(app):
    robot = app.session.state.live.robot
    before = robot.state().stamp
    until(lambda: robot.state().stamp > before + 0.5)
    told["page"] = "time goes on"
    app.session.stop()

told = {name: run(words) for name, words in json.loads(sys.argv[1]).items()}
with open_app(AppOptions(port=0)) as app:
    threading.Thread(target=watch, args=[app]).start()
    app.session.run()
print(json.dumps(told))
"""
"""Runs commands and then the page, in one process, which imports all libraries only once."""

SMALLEST = "--loops 1 --goals 2 --episodes 1 --finetune-steps 0 --step-limit 50 --predictor oracle"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return an environment whose Python processes, and those that they start, cannot import PyBullet."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text(WITHOUT_PYBULLET)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene of two small rooms."""
    folder = tmp_path_factory.mktemp("house")
    save(box_house(), folder / "house.glb")
    return folder


@pytest.fixture(scope="module")
def evaluation(folder: Path) -> tuple[str, ...]:
    house = ("--scene", str(folder / "house.glb"))
    return ("evaluate", *house, *SMALLEST.split(), "--processes", "1", "--folder", str(folder / "runs"))


@pytest.fixture(scope="module")
def told(environment: dict[str, str], folder: Path, evaluation: tuple[str, ...]) -> dict[str, Any]:
    """Return what each command said, by its name."""
    small, json_too = ("--scene", str(folder / "house.glb"), "--loops", "1"), ("--json", "-")
    one = ("--queries", "1", "--predictor", "oracle")
    commands = {
        "collect": ("collect", *small, "--output", str(folder / "drive.rrd"), *json_too),
        "bullet": ("collect", "--body", "bullet", "--output", str(folder / "never.rrd")),
        "demo": ("demo", "--headless", *small, *one, "--recording", str(folder / "demo.rrd"), *json_too),
        "evaluate": (*evaluation, *json_too),
    }
    done = subprocess.run(
        [sys.executable, "-c", ALL, json.dumps(commands)],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=4 * PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def summary(said: dict[str, Any]) -> dict[str, Any]:
    assert said["code"] == 0, said["stderr"]
    assert said["stderr"].count("planar") <= 1
    return json.loads(said["stdout"])


def test_a_tour_is_collected_and_names_its_body(told: dict[str, Any], folder: Path) -> None:
    assert summary(told["collect"])["frames"] > 10
    assert Recording.open(folder / "drive.rrd").meta.config["body"] == "planar"


def test_bullet_is_refused_with_a_line_that_names_what_runs(told: dict[str, Any], folder: Path) -> None:
    assert told["bullet"]["code"] == 1
    assert "--body planar" in told["bullet"]["stderr"]
    assert not (folder / "never.rrd").exists()


def test_the_headless_demo_runs(told: dict[str, Any]) -> None:
    assert summary(told["demo"])["queries"] == 1


def test_an_evaluation_runs_and_does_not_go_on_from_one_with_another_body(
    told: dict[str, Any], folder: Path, evaluation: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert summary(told["evaluate"])["episodes"] == 1
    plan = json.loads(next((folder / "runs").glob("*/*/run.json")).read_text())
    assert plan["protocol"]["body"] == "planar"
    pytest.importorskip("pybullet")
    refused = ltvn_here(capsys, *evaluation)
    assert refused.code == 1
    assert "body" in refused.stderr or "protocol" in refused.stderr


def test_the_page_opens_and_its_robot_moves_in_time(told: dict[str, Any]) -> None:
    assert told["page"] == "time goes on"


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
