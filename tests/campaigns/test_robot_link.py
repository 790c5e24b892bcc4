"""A robot of ROS 2 that is driven while a part between it and the driver dies or is suspended: it stands, and stays."""

import contextlib
import multiprocessing
import os
import re
import signal
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import Browser, Error

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.ros_robot import open_ros_robot
from ltvn_core.types import Twist
from ltvn_viz.verbs.robot_processes import PROFILE, start_guard, start_router
from tests.browser.conftest import chromium  # noqa: F401  (a fixture)
from tests.browser.drive_page import renderers
from tests.browser.pages import open_page
from tests.campaigns.served_body import Body, served_body
from tests.campaigns.tally import Tally
from tests.core.robots.ros2.processes import running
from tests.waiting import until

TURN = Twist(0.0, 0.6)
STANDS_S, STANDS_WITHOUT_LINK_S = 0.3, 0.4
PRESS_S = 3.0
STAYS_S = 1.0
"""So long it is watched afterwards, while whoever drove goes on asking."""


@dataclass
class Parts:
    """What is between driver and wheels, each a process."""

    address: str
    body: Body
    router: BaseProcess
    guard: BaseProcess
    toolkit: BaseProcess
    holds_key: Event

    def is_driven(self) -> bool:
        """Press the key anew, and tell whether the robot moves; a guard that was just started wants that."""
        self.holds_key.clear()
        time.sleep(STAYS_S)
        self.holds_key.set()
        ends_s = time.monotonic() + PRESS_S
        while not self.body.moves and time.monotonic() < ends_s:
            time.sleep(0.02)
        return self.body.moves

    def mend(self, name: str) -> None:
        """Start a part anew."""
        if name == "router":
            self.router = start_router(self.address)
        elif name == "guard":
            self.guard = start_guard(f"{PROFILE}@{self.address}")
        else:
            self.toolkit = start_toolkit(self.address, self.holds_key)


def start_toolkit(address: str, holds_key: Event) -> BaseProcess:
    """Start a program that drives as long as the key is held, whatever the robot says."""
    process = multiprocessing.get_context("spawn").Process(target=_drive, args=(address, holds_key))
    process.start()
    return process


def _drive(address: str, holds_key: Event) -> None:
    robot = open_ros_robot(f"{PROFILE}@{address}", patience_s=60.0)
    while os.getppid() > 1:
        time.sleep(0.05)
        with contextlib.suppress(RobotError):
            robot.observe()
        if holds_key.is_set():
            robot.drive(TURN)


@contextmanager
def parts() -> Iterator[Parts]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    holds_key = multiprocessing.get_context("spawn").Event()
    with ExitStack() as stack:
        router = start_router(address)
        stack.callback(router.kill)
        body = stack.enter_context(served_body(address))
        guard = start_guard(f"{PROFILE}@{address}")
        them = Parts(address, body, router, guard, start_toolkit(address, holds_key), holds_key)
        stack.callback(lambda: [each.kill() for each in (them.toolkit, them.guard, them.router)])
        yield them


def hit(
    tally: Tally, body: Body, strike: Callable[[], None], mend: Callable[[], None], *, within_s: float = STANDS_S
) -> None:
    """Strike while the robot drives; note how soon it stood, and whether it moved again after all was mended."""
    struck_s = time.monotonic()
    strike()
    took_s = body.stands_after(struck_s)
    if took_s > 0:
        tally.add(1, late=int(took_s > within_s))
        tally.most(longest_ms=1000 * took_s)
        tally.findings["quickest_ms"] = min(tally.findings.get("quickest_ms", 1e9), 1000 * took_s)
    else:
        tally.add(stood_already=1)  # A busy machine had held its driver up just then.
    moved_s = body.moved_s
    mend()
    until(lambda: time.monotonic() - struck_s > took_s + STAYS_S)
    time.sleep(STAYS_S)
    if body.moved_s > moved_s:
        tally.fail(f"it moved again {body.moved_s - struck_s:.2f} s after it was struck")


def judge(tally: Tally, within_s: float) -> None:
    assert tally.failures == []
    assert tally.findings.get("quickest_ms", 0.0) <= 1000 * within_s  # Others are counted: a busy machine may be late.


@pytest.mark.campaign(asked=50, share=0.025)
@pytest.mark.parametrize("name", ["toolkit", "guard", "router"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "suspended"])
def test_robot_stands(tally: Tally, name: str, number: signal.Signals) -> None:
    within_s = STANDS_WITHOUT_LINK_S if name == "router" else STANDS_S
    with parts() as them:
        for _ in tally.batches():
            until(them.is_driven)
            victim: BaseProcess = getattr(them, name)

            def mend(victim: BaseProcess = victim) -> None:
                if number is signal.SIGSTOP:
                    os.kill(victim.pid or 0, signal.SIGCONT)
                else:
                    victim.join()
                    if name != "toolkit":  # A new driver would be somebody who drives.
                        them.mend(name)

            hit(tally, them.body, partial(os.kill, victim.pid or 0, number), mend, within_s=within_s)
            them.holds_key.clear()
            if not victim.is_alive() and name == "toolkit":
                them.mend(name)
            time.sleep(STAYS_S)  # Its driver lets go.
    judge(tally, within_s)


def _send(processes: Sequence[psutil.Process], number: signal.Signals) -> None:
    for each in processes:
        with contextlib.suppress(psutil.Error):  # A page that was killed is gone.
            each.send_signal(number)


@pytest.mark.campaign(asked=50, share=0.025)
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "suspended"])
def test_robot_stands_without_page(
    tally: Tally,
    number: signal.Signals,
    tmp_path: Path,
    chromium: Browser,  # noqa: F811
) -> None:
    with parts() as them:
        them.toolkit.kill()
        app = ("--robot", f"{PROFILE}@{them.address}", "--port", "0", "--recordings", str(tmp_path))
        with running("ltvn_viz.verbs.app", "AppVerb", *app, ready="Ready.") as program:
            found = re.search(r"Open (\S+)", program.said)
            assert found is not None
            for _ in tally.batches():
                with (
                    contextlib.suppress(Error),
                    open_page(chromium, found[1], width=900, height=600, draws=False) as page,
                ):
                    page.get_by_text("Next:").wait_for()
                    until(lambda: page.keyboard.down("a") or them.body.moves)
                    send = partial(_send, renderers())
                    hit(tally, them.body, partial(send, number), partial(send, signal.SIGCONT))
                    page.keyboard.up("a")
    judge(tally, STANDS_S)
