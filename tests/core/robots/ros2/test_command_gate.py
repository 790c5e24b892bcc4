"""The guard's gate: fresh commands pass within limits; silence is one zero, and then a stop comes first."""

import math

import numpy as np
import pytest

from ltvn_core.errors import RobotError
from ltvn_core.robots.robot_spec import LOCOBOT, AccelerationLimits, SpeedLimits
from ltvn_core.robots.ros2.freshness import Freshness
from ltvn_core.robots.ros2.guard import CommandGate, DepthStop
from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.ros_messages import camera_info_message, image_message
from ltvn_core.robots.ros2.topic_keys import Attachment
from ltvn_core.robots.ros2.zenoh_link import Received
from ltvn_core.types import ZERO_TWIST, Twist

SLOW_STARTER = AccelerationLimits(linear_m_s2=1.0, angular_rad_s2=2.0)
GID, OTHER = bytes(16), bytes(range(16))


class Hand:
    """A clock that is moved by hand."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Hand:
    return Hand()


@pytest.fixture
def gate(clock: Hand) -> CommandGate:
    gate = CommandGate(clock, speeds=SpeedLimits(), accelerations=SLOW_STARTER)
    gate.hear(ZERO_TWIST)
    return gate


def test_a_gate_that_was_just_opened_wants_a_stop_first(clock: Hand) -> None:
    gate = CommandGate(clock, speeds=SpeedLimits(), accelerations=SLOW_STARTER)

    assert drive(gate, clock, Twist(0.2, 0.0), 0.3) == [None] * 6
    assert gate.hear(ZERO_TWIST) == ZERO_TWIST
    assert drive(gate, clock, Twist(0.2, 0.0), 0.3)[-1] == Twist(0.2, 0.0)


def drive(gate: CommandGate, clock: Hand, twist: Twist, seconds: float) -> list[Twist | None]:
    sent = []
    for _ in range(round(seconds / 0.05)):
        clock.now_s += 0.05
        sent.append(gate.hear(twist))
    return sent


def wait(gate: CommandGate, clock: Hand, seconds: float) -> list[Twist | None]:
    sent = []
    for _ in range(round(seconds / 0.05)):
        clock.now_s += 0.05
        sent.append(gate.turn())
    return sent


def test_a_command_is_reached_at_the_acceleration_of_the_robot(gate: CommandGate, clock: Hand) -> None:
    sent = drive(gate, clock, Twist(0.2, 0.0), 0.3)

    assert [each.linear_m_s for each in sent if each] == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.2, 0.2])


def test_a_command_beyond_the_limits_is_scaled_along_its_arc(gate: CommandGate, clock: Hand) -> None:
    last = drive(gate, clock, Twist(5.0, 5.0), 2.0)[-1]

    assert last == Twist(0.5, 0.5)


def test_silence_is_one_zero_within_the_lease(gate: CommandGate, clock: Hand) -> None:
    drive(gate, clock, Twist(0.2, 0.0), 0.3)

    assert gate.refuses_because == ""
    sent = wait(gate, clock, 2.0)

    assert "no command" in gate.refuses_because
    assert sent.count(ZERO_TWIST) == 1
    assert sent.index(ZERO_TWIST) * 0.05 <= 0.25
    assert all(each is None for each in sent[sent.index(ZERO_TWIST) + 1 :])


def test_after_silence_a_stop_comes_before_the_next_command(gate: CommandGate, clock: Hand) -> None:
    drive(gate, clock, Twist(0.2, 0.0), 0.3)
    wait(gate, clock, 1.0)

    assert drive(gate, clock, Twist(0.2, 0.0), 0.3) == [None] * 6
    assert gate.hear(ZERO_TWIST) == ZERO_TWIST
    assert gate.refuses_because == ""
    assert drive(gate, clock, Twist(0.2, 0.0), 0.05) == [pytest.approx(Twist(0.05, 0.0))]


def test_only_a_command_that_is_cut_down_counts_as_restrained(clock: Hand) -> None:
    def no_way_ahead(twist: Twist) -> Twist:
        return Twist(min(twist.linear_m_s, 0.0), twist.angular_rad_s)

    gate = CommandGate(clock, speeds=SpeedLimits(), accelerations=SLOW_STARTER, allows=no_way_ahead)

    for twist, is_restrained in ((ZERO_TWIST, False), (Twist(0.2, 0.0), True), (Twist(-0.2, 0.0), False)):
        gate.hear(twist)
        assert gate.is_restrained == is_restrained


def test_a_stop_is_passed_on_at_once_and_needs_nothing_after_it(gate: CommandGate, clock: Hand) -> None:
    drive(gate, clock, Twist(0.5, 0.0), 1.0)

    assert drive(gate, clock, ZERO_TWIST, 0.05) == [ZERO_TWIST]
    assert wait(gate, clock, 1.0) == [None] * 20
    assert drive(gate, clock, Twist(0.2, 0.0), 0.05) == [pytest.approx(Twist(0.05, 0.0))]


def test_a_guard_that_was_stopped_itself_lets_nothing_through_until_a_stop(gate: CommandGate, clock: Hand) -> None:
    drive(gate, clock, Twist(0.2, 0.0), 0.3)
    clock.now_s += 5.0

    assert gate.hear(Twist(0.2, 0.0)) == ZERO_TWIST
    assert gate.hear(Twist(0.2, 0.0)) is None
    assert wait(gate, clock, 1.0) == [None] * 20


def test_an_invalid_command_stops_the_robot_and_is_not_the_stop_that_the_driver_owes(
    gate: CommandGate, clock: Hand
) -> None:
    drive(gate, clock, Twist(0.2, 0.0), 0.3)
    assert gate.halt("a command was invalid") == ZERO_TWIST
    assert drive(gate, clock, Twist(0.2, 0.0), 0.1) == [None] * 2

    assert gate.hear(ZERO_TWIST) == ZERO_TWIST
    assert gate.refuses_because == ""


def test_fresh_messages_pass_whatever_the_senders_clock_says() -> None:
    check = Freshness("/cmd_vel", most_late_s=0.2)

    for number in range(100):
        check.admit(Attachment(number, int((5e8 + 0.1 * number) * 1e9), GID), 7.0 + 0.1 * number)


def test_late_messages_are_refused() -> None:
    check = Freshness("/cmd_vel", most_late_s=0.2)
    check.admit(Attachment(1, 10**9, GID), 50.0)

    with pytest.raises(RobotError, match=r"/cmd_vel: a message is 0\.9 s late"):
        check.admit(Attachment(2, int(1.1e9), GID), 51.0)


def test_messages_out_of_order_are_refused() -> None:
    check = Freshness("/cmd_vel", most_late_s=0.2)
    check.admit(Attachment(5, 10**9, GID), 50.0)

    with pytest.raises(RobotError, match="message 4 came after 5"):
        check.admit(Attachment(4, 10**9, GID), 50.0)


def test_messages_from_the_future_are_refused() -> None:
    check = Freshness("/cmd_vel", most_late_s=0.2)
    check.admit(Attachment(1, 10**9, GID), 50.0)

    with pytest.raises(RobotError, match=r"from 9\.9 s in the future"):
        check.admit(Attachment(2, 11 * 10**9, GID), 50.1)


def test_a_second_sender_is_refused_until_the_first_is_silent() -> None:
    check = Freshness("/cmd_vel", most_late_s=0.2)
    check.admit(Attachment(1, 10**9, GID), 50.0)

    with pytest.raises(RobotError, match="two senders at once"):
        check.admit(Attachment(1, 10**9, OTHER), 50.5)
    check.admit(Attachment(2, 10**9, OTHER), 51.5)


@pytest.mark.parametrize(
    ("depth_m", "reason"),
    [
        (0.3, "there is an obstacle 0.12 m in front of the robot"),
        (3.0, None),
        (0.0, "the depth image is empty"),
        (math.nan, "the depth image is empty"),
    ],
)
def test_forward_is_refused_where_depth_forbids_it(depth_m: float, reason: str | None) -> None:
    stop = DepthStop(open_profile("sim"), 0.4)
    lens = Received(camera_info_message(LOCOBOT.camera, 1.0), Attachment(1, 1, GID), 0.0)
    stop.take_camera_info(lens)
    image = image_message(np.full((72, 96), depth_m, np.float32), 1.0)

    assert stop.allows(Twist(0.3, 0.2)) == Twist(0.0, 0.2)
    stop.take_depth(Received(image, Attachment(1, 1, GID), math.inf))

    assert stop.reason == reason
    assert stop.allows(Twist(0.3, 0.2)) == (Twist(0.3, 0.2) if reason is None else Twist(0.0, 0.2))
    assert stop.allows(Twist(-0.3, 0.2)) == Twist(-0.3, 0.2)
