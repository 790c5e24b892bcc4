"""Which pages are there: signs of life, silence, and a server that stalls."""

from datetime import datetime

import pytest

from ltvn_viz.server.presence import HERE_LEASE_S, TICK_S, Absence, Loss, Presence
from tests.viz.server.test_driver_seat import ANN, BOB, Clock

NOON = datetime(2030, 1, 2, 12, 0)


@pytest.fixture
def clock() -> Clock:
    return Clock()


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
