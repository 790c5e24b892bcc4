"""One word says how well the app keeps up; the numbers behind it and the meaning of symbols are for whoever asks."""

from dataclasses import replace
from html import escape

import pytest

from ltvn_core.navigation.events import Severity
from ltvn_viz.panels.status_panel import Health, health_button, health_numbers, health_of
from ltvn_viz.server.glossary import TERMS, explained
from ltvn_viz.session.snapshot import LoopRates, Message, Snapshot
from ltvn_viz.session.snapshot_builder import RateMeter


@pytest.mark.parametrize(
    ("rates", "health"),
    [
        (LoopRates(), Health.GOOD),
        (LoopRates(loop_hz=30.0, frame_age_ms=40.0, dropped=1512), Health.GOOD),
        (LoopRates(loop_hz=12.0), Health.SLOW),
        (LoopRates(loop_hz=30.0, frame_age_ms=800.0), Health.SLOW),
        (LoopRates(loop_hz=2.0), Health.TROUBLE),
        (LoopRates(loop_hz=30.0, frame_age_ms=9000.0), Health.TROUBLE),
    ],
)
def test_what_a_person_would_notice_is_slow_and_nothing_else(rates: LoopRates, health: Health) -> None:
    found, reason = health_of(Snapshot(rates=rates))
    assert found is health
    assert escape(reason) in health_button(Snapshot(rates=rates))


def test_what_a_person_asked_in_vain_is_no_trouble_of_the_app() -> None:
    refused = Message("box 2 cannot stand there", Severity.ERROR, 1)
    assert health_of(Snapshot(message=refused))[0] is Health.GOOD


def test_a_failure_of_the_app_is_trouble_and_its_words_are_the_reason() -> None:
    snapshot = Snapshot(message=Message("the disk is <full>", Severity.ERROR, 1, is_trouble=True))
    assert health_of(snapshot)[0] is Health.TROUBLE
    assert "the disk is &lt;full&gt;" in health_button(snapshot)


def test_the_numbers_are_there_for_whoever_asks() -> None:
    shown = health_numbers(replace(Snapshot(), rates=LoopRates(29.7, 41.0, 1512), weights="abc<"))
    assert "30 times a second" in shown
    assert "1,512" in shown
    assert "abc&lt;" in shown


def test_a_few_ticks_that_come_together_are_no_rate() -> None:
    now = [0.0]
    meter = RateMeter(lambda: now[0])
    for tick in range(4):
        now[0] = 0.001 * tick
        meter.count()
    assert meter.hz == 0.0
    for tick in range(60):
        now[0] = 5.0 + tick / 30
        meter.count()
    assert meter.hz == pytest.approx(30.0, abs=1.5)


def test_every_symbol_of_the_answers_explains_itself() -> None:
    symbols = {term.symbol for term in TERMS}
    assert {"d", "r", "mu", "p", "R_p"} <= symbols
    assert 'title="' in explained("R_p")
    assert explained("no <such> word") == "no &lt;such&gt; word"
