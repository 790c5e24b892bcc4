"""What pages can cause at will is logged now and then, with how many lines were left out."""

import logging

import pytest

from ltvn_viz.server.limited_log import EVERY_S, LimitedLog
from tests.viz.server.test_driver_seat import Clock


def test_a_flood_is_one_line_and_a_count(caplog: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    log = LimitedLog(logging.getLogger("flood"), clock=clock)
    for page in range(1000):
        log.log(logging.WARNING, "page %d stopped", page)
    clock.wait(EVERY_S)
    log.log(logging.WARNING, "page %d stopped", 7)
    assert [record.getMessage() for record in caplog.records] == [
        "page 0 stopped",
        "page 7 stopped (and 999 more like it before)",
    ]
