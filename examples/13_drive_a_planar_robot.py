"""Drive a simulated robot of your own size and speed to a goal in a ready-made map, and print what happens.

`python examples/13_drive_a_planar_robot.py` needs no PyBullet: the robot is a disc in the plane. With a real robot the
call is the same; `docs/how-to/own-robot.md` says what it must have.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

import ltvn_core as ltvn
from ltvn_core.navigation.events import AttemptEnded, Event, Planned, QueryEnded, QueryStarted
from ltvn_core.robots.robot_spec import SpeedLimits

MAP = Path(__file__).parents[1] / "recordings" / "demo-map.rrd"
MY_ROBOT = replace(ltvn.LOCOBOT, name="small robot", radius_m=0.15, speeds=SpeedLimits(linear_m_s=0.4))
START, GOAL = 1166, 2794


def main() -> None:
    """Put the robot where one node was seen and drive it to another."""
    known = ltvn.TopologicalMap.load(MAP)
    start, goal = (known.keyframes.observation(node).exact_pose for node in (START, GOAL))
    assert start is not None, "The map was made in simulation, where exact poses are known."
    assert goal is not None
    robot = ltvn.open_simulation("demo", seed=0, start=start, spec=MY_ROBOT, body="planar").robot

    def tell(event: Event) -> None:
        if isinstance(event, QueryStarted | Planned | AttemptEnded | QueryEnded):
            print(f"{robot.state().stamp:5.1f} s  {ltvn.analysis.describe_event(event).text}")

    known.navigator(robot).drive_to(GOAL, consume=tell)
    gap_m = np.hypot(*(robot.exact_pose - goal)[:2])
    print(f"The {MY_ROBOT.name} stands {gap_m:.2f} m from where the image of node {GOAL} was taken.")


if __name__ == "__main__":
    main()
