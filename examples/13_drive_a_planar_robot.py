"""Drive a simulated robot of your own size and speed to a goal in a ready-made map, and print what happens.

`python examples/13_drive_a_planar_robot.py` needs no PyBullet: the robot is a disc in the plane. With a real robot the
loop is the same; `docs/how-to/own-robot.md` says what it must have.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import ltvn_core as ltvn
from ltvn_core.analysis.event_text import describe_event
from ltvn_core.navigation.events import AttemptEnded, Planned, QueryEnded, QueryStarted
from ltvn_core.robots.robot_spec import LOCOBOT, SpeedLimits
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.types import CONTROL_STEP_S

MAP = Path(__file__).parents[1] / "recordings" / "demo-map.rrd"
MY_ROBOT = replace(LOCOBOT, name="small robot", radius_m=0.15, speeds=SpeedLimits(linear_m_s=0.4))
START, GOAL = 1166, 2794


def main() -> None:
    """Put the robot where one node was seen and drive it to another."""
    known = ltvn.TopologicalMap.load(MAP)
    start, goal = (known.keyframes.observation(node).exact_pose for node in (START, GOAL))
    assert start is not None, "The map was made in simulation, where exact poses are known."
    assert goal is not None
    robot = open_simulation("demo", seed=0, start=start, spec=MY_ROBOT, body="planar").robot

    for event in known.navigator(robot).query(GOAL, 0):
        if isinstance(event, ltvn.Tick):
            robot.clock.advance(CONTROL_STEP_S)
        elif isinstance(event, QueryStarted | Planned | AttemptEnded | QueryEnded):
            print(f"{robot.state().stamp:5.1f} s  {describe_event(event).text}")

    gap_m = np.hypot(*(robot.exact_pose - goal)[:2])
    print(f"The {MY_ROBOT.name} stands {gap_m:.2f} m from where the image of node {GOAL} was taken.")


if __name__ == "__main__":
    main()
