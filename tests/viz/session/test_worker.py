"""Long jobs: they hold up nothing, they keep their order, and one that fails is told once."""

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.types import ZERO_TWIST, Pose, Twist
from ltvn_viz.session.camera_feed import LargerFeed
from ltvn_viz.session.job import Job, Phase
from ltvn_viz.session.worker import Worker
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import InlineExecutor, SessionHarness, said
from tests.waiting import PATIENCE_S


class Gate:
    """Holds a job until the test lets it pass."""

    def __init__(self) -> None:
        self.entered, self.open = threading.Event(), threading.Event()

    def __call__(self) -> str:
        self.entered.set()
        assert self.open.wait(PATIENCE_S)
        return "through"


def test_a_person_drives_while_the_worker_is_busy(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    harness, gate = SessionHarness(tmp_path, executor=executor), Gate()
    harness.state.worker.submit(gate, lambda _: None)
    assert gate.entered.wait(PATIENCE_S)
    harness.driver.twist = Twist(0.4, 0.0)
    before = harness.robot.pose.copy()
    harness.wait(30)
    assert not np.array_equal(harness.robot.pose, before)
    harness.driver.twist = None
    harness.wait()
    assert harness.robot.twist == ZERO_TWIST
    gate.open.set()
    harness.state.worker.settle()


def test_the_robot_does_not_move_while_the_navigator_thinks(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    harness, gate = SessionHarness(tmp_path, executor=executor), Gate()
    harness.wait()
    harness.state.worker.settle()
    harness.do(c.Ask(c.Action.GOAL, int(harness.now.moment.graph.ids[-1])), ticks=0)
    harness.state.worker.submit(gate, lambda _: None)  # Stands before the first thought.
    step = harness.robot.step
    harness.wait(10)
    assert harness.robot.step == step
    harness.do(c.Ask(c.Action.STOP))
    assert harness.robot.twist == ZERO_TWIST
    gate.open.set()
    harness.until(lambda now: now.mode is Mode.TELEOP)


def test_results_are_dealt_with_in_the_order_of_the_jobs(executor: ThreadPoolExecutor) -> None:
    worker, dealt = Worker(executor), []
    for number in range(20):
        worker.submit(lambda number=number: number, dealt.append)
    worker.settle()
    assert dealt == list(range(20))
    assert worker.pending == 0


def test_a_failing_job_is_told_once_and_the_next_goes_on() -> None:
    worker, dealt = Worker(InlineExecutor()), []
    worker.submit(lambda: 1 / 0, dealt.append)
    worker.submit(lambda: "fine", dealt.append)
    with pytest.raises(ZeroDivisionError):
        worker.collect()
    worker.collect()
    assert dealt == ["fine"]


def test_a_job_whose_plug_in_exits_has_failed_and_can_begin_again() -> None:
    job = Job[None](Worker(InlineExecutor()))
    for _ in range(2):
        job.begin("Making", lambda _: sys.exit(2), lambda: None)
        job.collect()
        assert job.phase is Phase.FAILED


def test_building_can_be_cancelled_and_keeps_the_old_map(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    harness = SessionHarness(tmp_path, executor=executor)
    harness.wait()
    harness.state.worker.settle()
    before = set(harness.state.live_map.graph.nodes)
    gate = Gate()
    harness.state.worker.submit(gate, lambda _: None)  # Building cannot begin before it is cancelled.
    harness.do(c.Ask(c.Action.BUILD))
    assert harness.now.mode is Mode.BUILDING
    assert harness.now.work is not None
    harness.do(c.Ask(c.Action.CANCEL))
    gate.open.set()
    harness.until(lambda now: now.mode is Mode.TELEOP)
    assert set(harness.state.live_map.graph.nodes) == before


def test_building_from_nothing_says_what_to_do_first(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path, mapped=False)
    harness.state.live_map.keyframes.keep_only([])
    harness.do(c.Ask(c.Action.BUILD), ticks=2)
    assert harness.now.mode is Mode.TELEOP
    assert "drive a little first" in said(harness.now)


def test_the_map_grows_while_one_drives(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path, mapped=False)
    harness.driver.twist = Twist(0.4, 0.4)
    harness.wait(200)
    assert len(harness.now.moment.graph.ids) > 5
    assert len(harness.now.moment.graph.p) > 5
    assert harness.now.gallery
    assert harness.state.goals.thumbnails.get(harness.now.gallery[0])


def test_the_newest_pose_wins_in_the_persons_camera() -> None:
    gate, drawn, second = Gate(), [], threading.Event()

    def render(pose: Pose, is_fine: bool) -> bytes:
        drawn.append(float(pose[0]))
        if len(drawn) == 1:
            gate()
        else:
            second.set()
        return b""

    times = iter(np.arange(0.0, 100.0, 1.0))
    feed = LargerFeed(render, clock=lambda: float(next(times)))
    feed.latest_image(np.array([0.0, 0, 0]), is_shown=True)
    assert gate.entered.wait(PATIENCE_S)
    for x in (1.0, 2.0, 3.0):
        picture = feed.latest_image(np.array([x, 0, 0]), is_shown=True)
    gate.open.set()
    assert second.wait(PATIENCE_S)
    feed.close()
    assert drawn == [0.0, 3.0]
    assert picture.dropped == 2
