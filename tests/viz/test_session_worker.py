"""Long jobs: they hold up nothing, they keep their order, and one that fails is told once."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import MapError
from ltvn_core.types import STILL, Depth, Pose, Rgb, Twist
from ltvn_viz import commands as c
from ltvn_viz.feed import CameraFeed
from ltvn_viz.modes import Mode
from ltvn_viz.worker import Worker
from tests.viz.theatre import Inline, Theatre


class Gate:
    """Holds a job until the test lets it pass."""

    def __init__(self) -> None:
        self.entered, self.open = threading.Event(), threading.Event()

    def __call__(self) -> str:
        self.entered.set()
        assert self.open.wait(10)
        return "through"


@pytest.fixture
def executor() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def test_a_person_drives_while_the_worker_is_busy(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    theatre, gate = Theatre(tmp_path, executor=executor), Gate()
    theatre.stage.worker.submit(gate, lambda _: None)
    assert gate.entered.wait(10)
    theatre.driver.twist = Twist(0.4, 0.0)
    before = theatre.robot.pose.copy()
    theatre.wait(30)
    assert not np.array_equal(theatre.robot.pose, before)
    theatre.driver.twist = None
    theatre.wait()
    assert theatre.robot.twist == STILL
    gate.open.set()
    theatre.stage.worker.settle()


def test_the_robot_does_not_move_while_the_navigator_thinks(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    theatre, gate = Theatre(tmp_path, executor=executor), Gate()
    theatre.wait()
    theatre.stage.worker.settle()
    theatre.do(c.NavigateTo(int(theatre.now.moment.graph.ids[-1])), ticks=0)
    theatre.stage.worker.submit(gate, lambda _: None)  # Stands before the first thought.
    step = theatre.robot.step
    theatre.wait(10)
    assert theatre.robot.step == step
    theatre.do(c.Stop())
    assert theatre.robot.twist == STILL
    gate.open.set()
    theatre.until(lambda now: now.mode is Mode.TELEOP)


def test_results_are_dealt_with_in_the_order_of_the_jobs(executor: ThreadPoolExecutor) -> None:
    worker, dealt = Worker(executor), []
    for number in range(20):
        worker.submit(lambda number=number: number, dealt.append)
    worker.settle()
    assert dealt == list(range(20))
    assert worker.pending == 0


def test_a_failing_job_is_told_once_and_the_next_goes_on() -> None:
    worker, dealt = Worker(Inline()), []

    def fail() -> None:
        raise MapError("no map")

    worker.submit(fail, dealt.append)
    worker.submit(lambda: "fine", dealt.append)
    with pytest.raises(MapError):
        worker.collect()
    worker.collect()
    assert dealt == ["fine"]


def test_building_can_be_cancelled_and_keeps_the_old_map(tmp_path: Path, executor: ThreadPoolExecutor) -> None:
    theatre = Theatre(tmp_path, executor=executor)
    theatre.wait()
    theatre.stage.worker.settle()
    before = set(theatre.stage.mapping.graph.nodes)
    gate = Gate()
    theatre.stage.worker.submit(gate, lambda _: None)  # Building cannot begin before it is cancelled.
    theatre.do(c.BuildMap())
    assert theatre.now.mode is Mode.BUILDING
    assert theatre.now.work is not None
    theatre.do(c.Cancel())
    gate.open.set()
    theatre.until(lambda now: now.mode is Mode.TELEOP)
    assert set(theatre.stage.mapping.graph.nodes) == before


def test_building_replaces_the_map_and_the_page_shows_the_new_one(tmp_path: Path) -> None:
    theatre = Theatre(tmp_path)
    theatre.wait()
    theatre.do(c.BuildMap(), ticks=3)
    assert theatre.now.mode is Mode.TELEOP
    assert theatre.now.moment.graph.ids.tolist() == list(theatre.stage.mapping.graph.nodes)
    assert len(theatre.now.moment.graph.p) == len(theatre.stage.mapping.graph.edges)


def test_building_from_nothing_says_what_to_do_first(tmp_path: Path) -> None:
    theatre = Theatre(tmp_path, mapped=False)
    theatre.stage.mapping.views.keep_only([])
    theatre.do(c.BuildMap(), ticks=2)
    assert theatre.now.mode is Mode.TELEOP
    assert theatre.now.message is not None
    assert "drive a little first" in theatre.now.message.text


def test_the_map_grows_while_one_drives(tmp_path: Path) -> None:
    theatre = Theatre(tmp_path, mapped=False)
    theatre.driver.twist = Twist(0.4, 0.4)
    theatre.wait(200)
    assert len(theatre.now.moment.graph.ids) > 5
    assert len(theatre.now.moment.graph.p) > 5
    assert theatre.now.gallery
    assert theatre.thumbnails.get(theatre.now.gallery[0])


def test_the_newest_pose_wins_in_the_persons_camera() -> None:
    gate, drawn, second = Gate(), [], threading.Event()

    def render(pose: Pose) -> tuple[Rgb, Depth]:
        drawn.append(float(pose[0]))
        if len(drawn) == 1:
            gate()
        else:
            second.set()
        return np.zeros((2, 2, 3), np.uint8), np.ones((2, 2), np.float32)

    times = iter(np.arange(0.0, 100.0, 1.0))
    feed = CameraFeed(render, clock=lambda: float(next(times)))
    feed.look(np.array([0.0, 0, 0]))
    assert gate.entered.wait(10)
    for x in (1.0, 2.0, 3.0):
        picture = feed.look(np.array([x, 0, 0]))
    gate.open.set()
    assert second.wait(10)
    feed.close()
    assert drawn == [0.0, 3.0]
    assert picture.dropped == 2
