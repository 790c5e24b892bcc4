"""The guard in a process of its own: what it forwards, and that the wheels get a zero whatever dies."""

import math
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from queue import Empty, SimpleQueue

import numpy as np
import pytest

from ltvn_core.robots.ros2.profile import shipped_profiles
from ltvn_core.robots.ros2.ros_messages import read_twist, twist_message
from ltvn_core.robots.ros2.ros_robot import open_ros_robot
from ltvn_core.robots.ros2.topic_keys import TWIST, TWIST_STAMPED, Topic
from ltvn_core.robots.ros2.zenoh_link import Received, TopicPublisher, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist
from tests.core.robots.ros2.meddled_link import meddled_robot
from tests.core.robots.ros2.processes import Program, running
from tests.platforms import needs_linux
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.slow

TURN = Twist(0.0, 0.5)
TURN_BACK = Twist(0.0, -0.5)


class Bench:
    """Wheels that write down what reaches them, a driver, and the guard between."""

    def __init__(self, link: ZenohLink, guard: Program, driver: TopicPublisher) -> None:
        self.link, self.guard, self.driver = link, guard, driver
        self.reached: SimpleQueue[Twist] = SimpleQueue()
        link.subscribe(Topic("/cmd_vel", TWIST), self._take, lambda error: None)
        until(lambda: driver.has_listener)
        self.drive(ZERO_TWIST)

    def drive(self, twist: Twist) -> None:
        self.driver.put(twist_message(twist, None))

    def drive_off(self) -> Twist:
        """Stop and drive, again where the guard was not given the processor in between: then it wants another stop.

        Returns the first motion that reached the wheels.
        """
        return until(self._first_motion) or ZERO_TWIST

    def _first_motion(self) -> Twist | None:
        self.drive(ZERO_TWIST)
        self.drive(TURN)
        try:
            while (reached := self.reached.get(timeout=1.0)) == ZERO_TWIST:
                pass
        except Empty:
            return None
        return reached

    def next_that(self, is_zero: bool) -> float:
        """Wait for such a command at the wheels, and return the time on the steady clock."""
        while (self.reached.get(timeout=PATIENCE_S) == ZERO_TWIST) != is_zero:
            pass
        return time.monotonic()

    def _take(self, received: Received) -> None:
        self.reached.put(read_twist(received.message, "/cmd_vel"))


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The profile of a robot behind a guard."""
    file = tmp_path_factory.mktemp("profile") / "guarded.toml"
    file.write_text(shipped_profiles()["sim"].replace("guarded = false", "guarded = true"), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def bench(guarded: Path) -> Iterator[Bench]:
    with ZenohLink.listen("tcp/127.0.0.1:0", node="bench") as link:
        robot = f"{guarded}@{link.address}"
        with running("ltvn_core.verbs.guard", "GuardVerb", robot, ready="Guarding") as guard:
            yield Bench(link, guard, link.publisher(Topic("/ltvn/cmd_vel", TWIST)))


def suspend(guard: Program) -> None:
    guard.process.send_signal(signal.SIGSTOP)
    until(lambda: Path(f"/proc/{guard.process.pid}/stat").read_text(encoding="utf-8").split()[2] == "T")


def test_commands_are_forwarded_and_silence_is_one_zero(bench: Bench) -> None:
    bench.drive_off()
    bench.next_that(is_zero=True)

    bench.drive(TURN)  # It drove, fell silent, and sent no stop.
    bench.guard.wait_until_it_says("must first send a stop")
    assert bench.reached.empty()
    bench.drive(ZERO_TWIST)
    bench.next_that(is_zero=True)


@pytest.mark.parametrize("broken", [Twist(math.nan, 0.0), Twist(0.0, math.inf)])
def test_a_command_that_is_not_finite_is_not_the_stop_that_a_driver_owes(bench: Bench, broken: Twist) -> None:
    bench.drive_off()
    bench.next_that(is_zero=True)

    for _ in range(3):
        bench.drive(broken)
        bench.drive(TURN_BACK)
    assert bench.drive_off().angular_rad_s > 0, "what was driven after a broken command has moved the wheels"
    bench.next_that(is_zero=True)


def test_a_command_of_another_type_is_named_and_moves_nothing(bench: Bench) -> None:
    wrong = bench.link.publisher(Topic("/ltvn/cmd_vel", TWIST_STAMPED))
    wrong.put(twist_message(TURN, time.time()))

    bench.guard.wait_until_it_says("geometry_msgs/msg/TwistStamped, expected geometry_msgs/msg/Twist")
    assert bench.reached.empty()


@needs_linux
def test_a_guard_that_was_suspended_forwards_nothing_old(bench: Bench) -> None:
    bench.drive_off()
    suspend(bench.guard)
    begun_s = time.monotonic()
    until(lambda: bench.drive(TURN) or time.monotonic() - begun_s > 0.6)
    bench.guard.process.send_signal(signal.SIGCONT)

    bench.next_that(is_zero=True)
    bench.drive_off()


@needs_linux
def test_a_driver_is_told_why_the_guard_stopped_its_robot_and_may_drive_on(guarded: Path) -> None:
    with meddled_robot() as body:
        name = f"{guarded}@{body.link.address}"
        with running("ltvn_core.verbs.guard", "GuardVerb", name, ready="Guarding") as guard:
            robot = open_ros_robot(name, patience_s=PATIENCE_S)
            until(lambda: robot.drive(TURN) or body.moves)

            suspend(guard)
            begun_s = time.monotonic()
            until(lambda: robot.drive(TURN) or time.monotonic() - begun_s > 0.6)
            guard.process.send_signal(signal.SIGCONT)
            until(lambda: robot.drive(TURN) or "guard" in (robot.link_report().stopped_because or ""))

            until(lambda: not body.moves)
            until(lambda: robot.link_report().stopped_because is None)  # Nobody drives meanwhile.
            until(lambda: robot.drive(TURN) or body.moves)
            robot.close()


def test_the_driver_is_told_why_it_may_not_drive_forwards_only_while_a_guard_says_so(guarded: Path) -> None:
    with meddled_robot() as body:
        name = f"{guarded}@{body.link.address}"
        with running("ltvn_core.verbs.guard", "GuardVerb", name, "--depth-stop", "3", ready="Guarding") as guard:
            robot = open_ros_robot(name, patience_s=PATIENCE_S)
            body.depth = np.zeros_like(body.depth)
            until(lambda: robot.drive(Twist(0.2, 0.0)) or "empty" in (robot.link_report().restrained_because or ""))
            guard.process.kill()
            until(lambda: robot.link_report().restrained_because is None)
            robot.close()


def test_a_guard_that_ends_sends_a_last_zero(bench: Bench) -> None:
    bench.drive_off()
    bench.guard.process.terminate()

    bench.next_that(is_zero=True)
    bench.guard.process.wait(PATIENCE_S)
