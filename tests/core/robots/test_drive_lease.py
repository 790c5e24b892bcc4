"""A drive command holds for a lease and no longer."""

import threading
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ltvn_core.robots.drive_lease import LEASE_S, DriveLease, SpeedLimits
from ltvn_core.types import ZERO_TWIST, Twist

AHEAD = Twist(0.3, 0.0)


@dataclass
class Clock:
    """Time that moves when it is told to."""

    now_s: float = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock(100.0)


@pytest.fixture
def lease(clock: Clock) -> DriveLease:
    return DriveLease(clock)


def test_a_lease_lasts_250_milliseconds(lease: DriveLease, clock: Clock) -> None:
    assert LEASE_S == 0.25
    lease.grant(AHEAD)
    clock.now_s += 0.249
    assert lease.command() == AHEAD
    clock.now_s += 0.001
    assert lease.command() == ZERO_TWIST


def test_a_lease_expires_exactly_once(lease: DriveLease, clock: Clock) -> None:
    lease.grant(AHEAD)
    clock.now_s += 1.0
    for _ in range(5):
        assert lease.command() == ZERO_TWIST
        clock.now_s += 1.0
    assert lease.expiries == 1


def test_driving_on_renews_the_lease(lease: DriveLease, clock: Clock) -> None:
    for _ in range(20):
        lease.grant(AHEAD)
        clock.now_s += 0.2
        assert lease.command() == AHEAD
    assert lease.expiries == 0


def test_the_newest_command_counts(lease: DriveLease) -> None:
    lease.grant(AHEAD)
    lease.grant(Twist(-0.1, 0.5))
    assert lease.command() == Twist(-0.1, 0.5)


def test_cancelling_stops_at_once_and_is_no_expiry(lease: DriveLease, clock: Clock) -> None:
    lease.grant(AHEAD)
    lease.cancel()
    assert lease.command() == ZERO_TWIST
    clock.now_s += 1.0
    assert lease.command() == ZERO_TWIST
    assert lease.expiries == 0


def test_standing_still_on_command_never_expires(lease: DriveLease, clock: Clock) -> None:
    lease.grant(ZERO_TWIST)
    clock.now_s += 1.0
    assert lease.command() == ZERO_TWIST
    assert lease.expiries == 0


def test_nothing_is_commanded_at_first(lease: DriveLease) -> None:
    assert lease.command() == ZERO_TWIST


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_speed_that_is_no_number_is_refused_and_stops_the_robot(lease: DriveLease, bad: float) -> None:
    for twist in (Twist(bad, 0.0), Twist(0.0, bad)):
        lease.grant(AHEAD)
        with pytest.raises(ValueError, match="finite"):
            lease.grant(twist)
        assert lease.command() == ZERO_TWIST


@given(linear=st.floats(-1e6, 1e6), angular=st.floats(-1e6, 1e6))
def test_too_high_a_speed_is_slowed_down_along_its_arc(linear: float, angular: float) -> None:
    limits = SpeedLimits()
    slowed = limits.bounded(Twist(linear, angular))
    assert abs(slowed.linear_m_s) <= limits.linear_m_s * (1 + 1e-12)
    assert abs(slowed.angular_rad_s) <= limits.angular_rad_s * (1 + 1e-12)
    assert slowed.linear_m_s * angular == pytest.approx(slowed.angular_rad_s * linear, rel=1e-9)
    if abs(linear) <= limits.linear_m_s and abs(angular) <= limits.angular_rad_s:
        assert slowed == Twist(linear, angular)


def test_the_robot_may_be_told_half_a_metre_and_a_radian_per_second(lease: DriveLease) -> None:
    lease.grant(Twist(5.0, 0.0))
    assert lease.command() == Twist(0.5, 0.0)
    lease.grant(Twist(0.0, -7.0))
    assert lease.command() == Twist(0.0, -1.0)


def test_commands_from_several_threads_never_mix() -> None:
    clock = Clock()
    lease = DriveLease(clock)
    wishes = {Twist(0.1 * k, -0.1 * k) for k in range(1, 5)}
    start, seen = threading.Barrier(len(wishes) + 1), set()

    def drive(twist: Twist) -> None:
        start.wait()
        for _ in range(500):
            lease.grant(twist)

    threads = [threading.Thread(target=drive, args=(wish,)) for wish in wishes]
    for thread in threads:
        thread.start()
    start.wait()
    while any(thread.is_alive() for thread in threads):
        seen.add(lease.command())
    seen.add(lease.command())
    assert seen <= wishes | {ZERO_TWIST}
    assert lease.command() in wishes
    assert lease.expiries == 0


def test_of_many_readers_one_counts_the_expiry() -> None:
    clock = Clock()
    lease = DriveLease(clock)
    lease.grant(AHEAD)
    clock.now_s = 1.0
    readers, start = 8, threading.Barrier(8)

    def read() -> None:
        start.wait()
        lease.command()

    threads = [threading.Thread(target=read) for _ in range(readers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert lease.expiries == 1
