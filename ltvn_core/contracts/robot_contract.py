"""What a robot must do, as far as that can be found out without driving: its parts, its images, its clock."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from ltvn_core.contracts.contract_check import ContractCheck, require, run_checks
from ltvn_core.plugins import Plugin
from ltvn_core.preprocessing import admit_observation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_plugins import open_robot

LOOKS = 3


def robot_checks(plugin: Plugin) -> Iterator[ContractCheck]:
    """Make a robot and look through its camera; nothing is driven."""
    contract = RobotContract(plugin)
    return run_checks(
        ("is made, and takes a first image", contract.is_made),
        [
            ("takes images that its camera can take", contract.takes_images),
            ("counts steps and time upwards", contract.counts_upwards),
            ("stops when it is told to", contract.stops),
        ],
    )


@dataclass(frozen=True)
class RobotContract:
    """A robot that stands."""

    plugin: Plugin

    @cached_property
    def robot(self) -> Robot:
        """The robot itself."""
        return open_robot(self.plugin.name, {self.plugin.name: self.plugin})

    def is_made(self) -> str:
        """Look at its parts, as `ltvn app --robot` does."""
        camera = self.robot.spec.camera
        return f"{self.robot.spec.name}, camera {camera.width} x {camera.height}"

    def takes_images(self) -> str:
        """Look a few times."""
        camera = self.robot.spec.camera
        seen = [admit_observation(self.robot.observe(), camera, camera, source=self.plugin.name) for _ in range(LOOKS)]
        return f"{sum(each.has_depth for each in seen)} of {LOOKS} with depth"

    def counts_upwards(self) -> str:
        """Ask for its state a few times."""
        states = [self.robot.state() for _ in range(LOOKS)]
        for before, after in pairwise(states):
            require(
                after.step >= before.step and after.stamp >= before.stamp,
                f"step {before.step} at {before.stamp} s is followed by step {after.step} at {after.stamp} s",
            )
        return ""

    def stops(self) -> str:
        """Stop, where it stands already, and go."""
        self.robot.stop()
        getattr(self.robot, "close", self.robot.stop)()
        return ""
