"""The driver's seat: nothing but a fresh, armed input moves the robot, and nothing that was held before a stop."""

from datetime import datetime

import pytest

from ltvn_core.types import Twist
from ltvn_viz.server.driver_seat import (
    HAND_LIMIT_S,
    HERE_LEASE_S,
    IDLE_S,
    LEASE_S,
    MAX_ANGULAR_RAD_S,
    MAX_LINEAR_M_S,
    TICK_S,
    Absence,
    DriveAccepted,
    DriverSeat,
    HeldInput,
    Loss,
    MotionStopped,
    Presence,
    StopReason,
)
from ltvn_viz.server.keymap import Direction

EMPTY = HeldInput()
FORWARD = HeldInput(frozenset({Direction.FORWARD}))
ANN, BOB = 1, 2


class Clock:
    """A clock that stands until it is told."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def seat(clock: Clock) -> DriverSeat:
    return DriverSeat(clock=clock)


def hold(seat: DriverSeat, client: int, held: HeldInput = FORWARD) -> None:
    seat.receive(client, held, seat.state_of(client).epoch)


def arm(seat: DriverSeat, client: int) -> None:
    hold(seat, client, EMPTY)


def drive(seat: DriverSeat, client: int) -> None:
    arm(seat, client)
    hold(seat, client)


def test_a_held_key_drives_until_it_is_let_go(seat: DriverSeat) -> None:
    drive(seat, ANN)
    assert seat.current_twist() == Twist(MAX_LINEAR_M_S, 0.0)
    arm(seat, ANN)
    assert seat.current_twist() is None
    assert seat.take_events() == [
        DriveAccepted(ANN, Twist(MAX_LINEAR_M_S, 0.0)),
        MotionStopped(ANN, StopReason.RELEASED),
    ]


def test_a_page_that_draws_slowly_keeps_its_hold_and_drives_the_slower_the_older_it_is(
    seat: DriverSeat, clock: Clock
) -> None:
    arm(seat, ANN)
    speeds: list[float] = []
    for age_ms in range(0, 800, 50):
        seat.receive(ANN, FORWARD, 0, age_ms / 1000)
        twist = seat.current_twist()
        assert twist is not None
        speeds.append(twist.linear_m_s)
        clock.wait(0.05)
    assert speeds[0] == speeds[5] == MAX_LINEAR_M_S
    assert speeds[5:] == sorted(speeds[5:], reverse=True)
    assert 0 < speeds[-1] < MAX_LINEAR_M_S / 2
    hold(seat, ANN)
    assert seat.current_twist() == Twist(MAX_LINEAR_M_S, 0.0)


def test_nobody_repeats_a_held_key_for_longer_than_the_limit(seat: DriverSeat, clock: Clock) -> None:
    drive(seat, ANN)
    for age_ms in range(50, round(1000 * HAND_LIMIT_S), 50):
        clock.wait(0.05)
        seat.receive(ANN, FORWARD, 0, age_ms / 1000)
    assert seat.current_twist() is not None
    clock.wait(0.05)
    seat.receive(ANN, FORWARD, 0, HAND_LIMIT_S)
    assert seat.current_twist() is None
    assert seat.take_events()[-1] == MotionStopped(ANN, StopReason.INPUT_LOST)


def test_an_input_that_is_too_old_neither_arms_a_page_nor_gives_it_the_seat(seat: DriverSeat) -> None:
    seat.receive(ANN, EMPTY, 0, HAND_LIMIT_S)
    hold(seat, ANN)
    assert seat.current_twist() is None
    arm(seat, BOB)
    seat.receive(BOB, FORWARD, 0, HAND_LIMIT_S)
    assert seat.driver is None


def test_a_worker_that_dies_stops_the_robot_within_the_lease_however_patient_it_was(
    seat: DriverSeat, clock: Clock
) -> None:
    drive(seat, ANN)
    seat.receive(ANN, FORWARD, 0, 0.5)
    clock.wait(LEASE_S)
    assert seat.current_twist() is None


def test_keys_combine_and_opposite_ones_cancel_out() -> None:
    both = HeldInput(frozenset({Direction.FORWARD, Direction.LEFT}))
    assert both.twist() == Twist(MAX_LINEAR_M_S, MAX_ANGULAR_RAD_S)
    assert HeldInput(frozenset({Direction.FORWARD, Direction.BACKWARD})).twist() == Twist(0.0, 0.0)


def test_slow_is_slower() -> None:
    slow = HeldInput(frozenset({Direction.FORWARD}), is_slow=True).twist()
    assert 0 < slow.linear_m_s < MAX_LINEAR_M_S


def test_a_silent_page_stops_the_robot_after_the_lease(seat: DriverSeat, clock: Clock) -> None:
    drive(seat, ANN)
    clock.wait(LEASE_S - 0.001)
    assert seat.current_twist() is not None
    clock.wait(0.001)
    assert seat.current_twist() is None
    assert seat.take_events()[-1] == MotionStopped(ANN, StopReason.INPUT_LOST)


def test_a_poll_alone_notices_the_silence_when_the_receiving_thread_hangs(seat: DriverSeat, clock: Clock) -> None:
    drive(seat, ANN)
    assert seat.current_twist(clock.now + LEASE_S) is None


def test_a_heartbeat_after_lost_input_does_not_start_the_robot_again(seat: DriverSeat, clock: Clock) -> None:
    drive(seat, ANN)
    old_epoch = seat.state_of(ANN).epoch
    clock.wait(LEASE_S)
    for epoch in (old_epoch, seat.state_of(ANN).epoch):
        seat.receive(ANN, FORWARD, epoch)
        assert seat.current_twist() is None
    drive(seat, ANN)
    assert seat.current_twist() is not None


def test_an_empty_input_of_the_old_epoch_does_not_arm(seat: DriverSeat) -> None:
    drive(seat, ANN)
    old_epoch = seat.state_of(ANN).epoch
    seat.stop(ANN)
    seat.receive(ANN, EMPTY, old_epoch)
    hold(seat, ANN)
    assert seat.current_twist() is None


def test_anybody_may_stop_the_robot(seat: DriverSeat) -> None:
    drive(seat, ANN)
    seat.stop(BOB)
    assert seat.current_twist() is None
    hold(seat, ANN)
    assert seat.current_twist() is None
    assert seat.state_of(ANN).stopped_by == BOB


def test_a_second_person_watches_until_the_seat_is_free(seat: DriverSeat, clock: Clock) -> None:
    drive(seat, ANN)
    drive(seat, BOB)
    assert seat.state_of(BOB).driver == ANN
    arm(seat, ANN)
    clock.wait(IDLE_S)
    drive(seat, BOB)
    assert seat.state_of(ANN).driver == BOB


def test_a_key_that_a_watcher_holds_does_not_count_when_the_seat_becomes_free(seat: DriverSeat) -> None:
    drive(seat, ANN)
    drive(seat, BOB)
    seat.leave(ANN)
    hold(seat, BOB)
    assert seat.current_twist() is None


def test_taking_over_stops_the_robot_and_both_must_let_go(seat: DriverSeat) -> None:
    drive(seat, ANN)
    arm(seat, BOB)
    seat.take_over(BOB)
    assert seat.current_twist() is None
    for client in (ANN, BOB):
        hold(seat, client)
        assert seat.current_twist() is None
    drive(seat, BOB)
    assert seat.current_twist() is not None


def test_a_closed_page_stops_the_robot_it_moved(seat: DriverSeat) -> None:
    drive(seat, ANN)
    seat.leave(ANN)
    assert seat.current_twist() is None
    assert seat.state_of(BOB).driver is None


NOON = datetime(2030, 1, 2, 12, 0)


@pytest.fixture
def presence(clock: Clock) -> Presence:
    return Presence(clock=clock, today=lambda: NOON)


def let_pass(presence: Presence, clock: Clock, seconds: float) -> bool:
    """Let time pass as the server's thread does; tell whether the last page fell silent meanwhile."""
    fell_silent = False
    for _ in range(round(seconds / TICK_S)):
        clock.wait(TICK_S)
        fell_silent |= presence.tick()
    return fell_silent


def test_before_the_first_page_nobody_is_missed(presence: Presence, clock: Clock) -> None:
    assert not let_pass(presence, clock, 10.0)
    assert presence.absence is None


def test_a_page_that_says_so_is_there(presence: Presence, clock: Clock) -> None:
    for _ in range(100):
        presence.hear(ANN)
        assert not let_pass(presence, clock, HERE_LEASE_S / 2)
    assert presence.absence is None


def test_when_the_last_page_closes_nobody_is_there_at_once(presence: Presence) -> None:
    presence.hear(ANN)
    presence.hear(BOB)
    presence.leave(ANN)
    assert presence.absence is None
    presence.leave(BOB)
    assert presence.absence == Absence(Loss.CLOSED, NOON)


def test_a_silent_page_is_gone_within_300_ms_and_back_with_its_next_word(presence: Presence, clock: Clock) -> None:
    presence.hear(ANN)
    assert let_pass(presence, clock, 0.28)
    assert presence.absence == Absence(Loss.SILENT, NOON)
    presence.hear(ANN)
    assert presence.absence is None


def test_one_silent_page_of_two_is_not_missed(presence: Presence, clock: Clock) -> None:
    presence.hear(ANN)
    for _ in range(10):
        presence.hear(BOB)
        assert not let_pass(presence, clock, 0.1)
    presence.leave(BOB)
    assert presence.absence is not None


def test_a_server_that_stalls_takes_no_page_for_gone(presence: Presence, clock: Clock) -> None:
    presence.hear(ANN)
    clock.wait(5.0)
    assert not presence.tick()
    presence.hear(ANN)
    assert not let_pass(presence, clock, HERE_LEASE_S / 2)
    assert let_pass(presence, clock, 0.3)
