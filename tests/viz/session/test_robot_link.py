"""What the page says of the link to a robot that is not simulated."""

from dataclasses import replace

import pytest

from ltvn_core.navigation.events import Severity
from ltvn_core.robots.link_report import LinkQuality, LinkReport
from ltvn_viz.panels.status_panel import Health, health_numbers, health_of, link_line
from ltvn_viz.session.robot_link import RobotLink
from ltvn_viz.session.snapshot import Snapshot

WELL = LinkReport(
    is_connected=True, picture_age_s=0.05, odometry_age_s=0.02, pictures_hz=10.0, lost_share=0.0, battery=0.83
)


class Robot:
    """Says of its link what the test wants."""

    def __init__(self) -> None:
        self.report = WELL
        self.link = RobotLink("TurtleBot 4", lambda: self.report)

    def said(self, report: LinkReport) -> str:
        self.report = report
        news = self.link.look()
        return "" if news is None else news.text


def test_each_change_is_told_once_in_plain_words() -> None:
    robot = Robot()
    broken = replace(WELL, is_connected=False, picture_age_s=3.0)
    assert robot.said(WELL) == ""
    assert "TurtleBot 4 does not answer: the link broke. It is stopped" in robot.said(broken)
    assert robot.link.news is not None
    assert robot.link.news.is_lost
    assert robot.link.news.severity is Severity.ERROR
    assert robot.said(replace(broken, picture_age_s=4.0)) == ""
    held = robot.said(replace(WELL, stopped_because="the link to the robot broke"))
    assert held == "TurtleBot 4 was stopped: the link to the robot broke. Release the keys, then drive again."
    assert "answers again. " in robot.said(WELL)
    assert robot.link.news is None


def test_a_guard_that_refuses_to_drive_forwards_is_told_while_it_does_and_nothing_comes_after() -> None:
    robot = Robot()
    walled = replace(WELL, restrained_because="there is an obstacle 0.20 m in front of the robot")
    assert "0.20 m in front" in robot.said(walled)
    assert "0.20 m in front" in health_numbers(Snapshot(link=walled))
    assert robot.said(replace(walled, restrained_because="there is an obstacle 0.10 m in front of the robot")) == ""
    assert robot.said(WELL) == ""
    assert robot.link.news is None


@pytest.mark.parametrize(
    ("change", "quality", "health"),
    [
        ({}, LinkQuality.GOOD, Health.GOOD),
        ({"lost_share": 0.3}, LinkQuality.WEAK, Health.SLOW),
        ({"pictures_hz": 2.0}, LinkQuality.WEAK, Health.SLOW),
        ({"odometry_age_s": 0.4}, LinkQuality.WEAK, Health.SLOW),
        ({"picture_age_s": 0.7}, LinkQuality.LOST, Health.TROUBLE),
        ({"is_connected": False}, LinkQuality.LOST, Health.TROUBLE),
    ],
)
def test_a_weak_link_is_slow_and_a_lost_one_is_trouble(
    change: dict[str, float], quality: LinkQuality, health: Health
) -> None:
    report = replace(WELL, **change)
    assert report.quality is quality
    assert health_of(Snapshot(link=report))[0] is health


def test_the_line_is_quiet_and_the_numbers_are_behind_it() -> None:
    line = link_line(WELL)
    assert "link <b>good</b> · picture <b>0.1</b> s · odometry <b>0.0</b> s · battery <b>83%</b>" in line
    assert "battery" not in link_line(replace(WELL, battery=None))
    assert "10 a second, 0% got lost" in health_numbers(Snapshot(link=WELL))
    assert "got lost" not in health_numbers(Snapshot())
