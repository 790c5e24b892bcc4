"""Checks a robot before it is driven: rates, ages, lens, tilt and subscribers. Drives only with `--drive`."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ltvn_core.findings import Finding, Severity
from ltvn_core.geometry import wrap_angle
from ltvn_core.robots.robot_report import RobotReport, TopicReport, TurnReport, fit_floor, robot_findings
from ltvn_core.robots.ros2.ros_robot import STALE_S, RosRobot
from ltvn_core.types import Twist

LEAST_HZ = 5.0
_TURN = Twist(0.0, 0.3)
_TURNED_RAD = 0.01
_STANDS_RAD_S = 0.02
_PATIENCE_S = 3.0


def look_over(robot: RosRobot, *, seconds: float, drives: bool) -> RobotReport:
    """Watch a robot, and with `drives` turn it on the spot for at most 3 s. Raises RobotError."""
    topics, age_s = _watch(robot, seconds)
    camera = robot.spec.camera
    ends_s = time.monotonic() + _PATIENCE_S
    while robot.age_s > STALE_S and time.monotonic() < ends_s:
        time.sleep(0.02)  # A busy machine may have held up the last image.
    depth = robot.observe().require_depth("the check of a robot")
    taken = robot.has_listener
    report = RobotReport(
        robot=robot.spec.name,
        address=robot.link.address,
        topics=topics,
        image=f"{camera.width} x {camera.height}",
        field_of_view_deg=(math.degrees(camera.horizontal_fov_rad), math.degrees(camera.vertical_fov_rad)),
        depth_share=float(np.mean(depth > 0)),
        age_s=age_s,
        floor=fit_floor(depth, camera),
        commands_taken=taken,
        driving=_try_driving(robot) if drives and taken else None,
    )
    return replace(report, findings=tuple(_findings(report, robot)))


def _watch(robot: RosRobot, seconds: float) -> tuple[tuple[TopicReport, ...], float]:
    """Return the report of each topic, and the greatest age of the newest image in seconds."""
    streams = robot.inbox.streams
    counts = [stream.count for stream in streams]
    gaps = [0.0] * len(streams)
    worst_s = 0.0
    begun_s = time.monotonic()
    while (passed_s := time.monotonic() - begun_s) < seconds:
        time.sleep(0.02)
        worst_s = max(worst_s, robot.age_s)
        now_s = time.monotonic()
        gaps = [max(gap, stream.age_s(now_s) or 0.0) for gap, stream in zip(gaps, streams, strict=True)]
    reports = []
    for stream, count, gap in zip(streams, counts, gaps, strict=True):
        is_tree = stream is robot.inbox.odometry and robot.profile.odometry_transform is not None
        # Each node sends its own part of the tf tree.
        publishers = () if is_tree else tuple(robot.link.publishers(stream.topic))
        reports.append(TopicReport(stream.topic, (stream.count - count) / passed_s, gap, publishers))
    return tuple(reports), worst_s


def _findings(report: RobotReport, robot: RosRobot) -> Iterator[Finding]:
    for each in report.topics:
        if each.rate_hz < LEAST_HZ:
            text = f"{each.topic} arrives {each.rate_hz:.1f} times a second; at least {LEAST_HZ:g} are needed to drive."
            yield Finding(text, where=each.topic)
    yield from robot_findings(report)
    yield from (Finding(stream.refusal, where=stream.topic) for stream in robot.inbox.streams if stream.refusal)
    if not report.commands_taken:
        yield Finding(
            "No node receives the commands: start `ltvn guard` beside the robot, or correct `guarded`, `stamped` or "
            "the topic of commands in the profile."
        )
    bumper = robot.profile.topics.bumper
    if bumper and not robot.link.publishers(bumper):
        text = f"No node publishes {bumper}, so collisions are not detected; correct topics.bumper, or omit it."
        yield Finding(text, where=bumper)
    if report.driving is not None and None in (report.driving.moves_after_s, report.driving.stands_after_s):
        text = "The robot did not follow the command; keep a hand on its emergency stop."
        yield Finding(text, Severity.ERROR)


def _try_driving(robot: RosRobot) -> TurnReport:
    """Turn on the spot until odometry shows it, and stop."""
    before = robot.state().odometry[2]

    def turned() -> bool:
        robot.drive(_TURN)
        return abs(float(wrap_angle(robot.state().odometry[2] - before))) > _TURNED_RAD

    robot.stop()
    moves_after_s = _seconds_until(turned)
    robot.stop()
    return TurnReport(moves_after_s, _seconds_until(lambda: _stands(robot)))


def _stands(robot: RosRobot) -> bool:
    kept = list(robot.inbox.odometry.kept)[-2:]
    turned = abs(float(wrap_angle(kept[-1].content[2] - kept[0].content[2])))
    return turned <= _STANDS_RAD_S * max(kept[-1].stamp_s - kept[0].stamp_s, 1e-3)


def _seconds_until(ask: Callable[[], bool]) -> float | None:
    begun_s = time.monotonic()
    while not ask():
        if time.monotonic() - begun_s > _PATIENCE_S:
            return None
        time.sleep(0.01)
    return time.monotonic() - begun_s
