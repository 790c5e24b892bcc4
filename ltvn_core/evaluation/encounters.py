"""Encounters of the robot with people: how near they came, and whether an attentive driver would have touched anybody.

A person never walks into the robot, and steps aside when it comes too near, as far as there is room
(`simulation.changes.walking_person`). So a touch is the robot's doing. An attentive driver would have avoided it if the
robot drove towards the person, and either backwards, which is to drive blindly, or with the person in the camera's view
and nothing between them in the last second before. Reads exact poses; needs no navigation.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.geometry import relative
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.physics import PERSON_RADIUS_M
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import Pose
from ltvn_core.worlds.world_change import PersonMoved

BEGINS_M, ENDS_M = 1.5, 2.0
"""An encounter begins when a person is nearer than the first, and ends when farther than the second; from surface to
surface, as all distances here."""
_ATTENTION_S = 1.0
_TOUCH_M = 0.003


@dataclass(slots=True)
class Encounter:
    """The robot and one person, from when they came near until they parted."""

    person: str
    closest_m: float
    """Least distance between the two surfaces."""
    touched: bool = False
    gave_way: bool = False
    """Whether the person had to step aside."""
    avoidable: bool = False
    """Whether an attentive driver would not have touched the person."""
    seen_s: float = -math.inf
    """When the camera had the person in view last."""


@dataclass(frozen=True, slots=True)
class EncounterCounts:
    """Several encounters in numbers."""

    encounters: int = 0
    gave_way: int = 0
    """In which the person had to step aside."""
    touched: int = 0
    avoidable: int = 0
    """Touches that an attentive driver would have avoided."""
    closest_m: float | None = None
    """Least distance from surface to surface; None where nobody was met."""

    @classmethod
    def of(cls, encounters: Sequence[Encounter]) -> "EncounterCounts":
        """Count encounters."""
        return cls(
            encounters=len(encounters),
            gave_way=sum(each.gave_way for each in encounters),
            touched=sum(each.touched for each in encounters),
            avoidable=sum(each.avoidable for each in encounters),
            closest_m=min((each.closest_m for each in encounters), default=None),
        )

    def __add__(self, other: "EncounterCounts") -> "EncounterCounts":
        """Count both."""
        closest = [each for each in (self.closest_m, other.closest_m) if each is not None]
        return EncounterCounts(
            encounters=self.encounters + other.encounters,
            gave_way=self.gave_way + other.gave_way,
            touched=self.touched + other.touched,
            avoidable=self.avoidable + other.avoidable,
            closest_m=min(closest, default=None),
        )


class EncounterLog:
    """Watches robot and people at each control step."""

    def __init__(self, spec: RobotSpec = LOCOBOT) -> None:
        """Know nothing yet."""
        self._spec = spec
        self._under_way: dict[str, Encounter] = {}
        self.over: list[Encounter] = []
        """What has ended."""

    def take(
        self,
        stamp: float,
        robot: Pose,
        linear_m_s: float,
        people: Sequence[PersonMoved],
        clearance: ClearanceMap,
        stepping_aside: Collection[str] = (),
    ) -> None:
        """Take in where everybody is at `stamp` seconds.

        Args:
            stamp: Seconds on the robot's clock.
            robot: Where it is, (3,).
            linear_m_s: How fast its wheels drive.
            people: Where they are.
            clearance: What hides them.
            stepping_aside: Who makes room for the robot, see `World.stepping_aside`.
        """
        for person in people:
            gap = relative(robot, np.array(person.pose))
            away_m = float(np.hypot(gap[0], gap[1])) - self._spec.radius_m - PERSON_RADIUS_M
            encounter = self._under_way.get(person.person)
            if encounter is None:
                if away_m >= BEGINS_M:
                    continue
                encounter = self._under_way[person.person] = Encounter(person.person, away_m)
            encounter.closest_m = min(encounter.closest_m, away_m)
            if self._is_in_view(robot, np.array(person.pose), clearance):
                encounter.seen_s = stamp
            if away_m <= _TOUCH_M and not encounter.touched:
                encounter.touched = True
                towards = gap[0] * linear_m_s > 0
                attentive = linear_m_s < 0 or stamp - encounter.seen_s <= _ATTENTION_S
                encounter.avoidable = bool(towards and attentive)
            encounter.gave_way |= person.person in stepping_aside
            if away_m > ENDS_M:
                self.over.append(self._under_way.pop(person.person))
        self._part({each.person for each in people})

    def watch(self, robot: SimulatedRobot) -> None:
        """Take in where a robot and the people of its world are now."""
        world = robot.world
        if world is not None and world.state.people:
            self.take(
                robot.stamp,
                robot.exact_pose,
                robot.speeds.linear_m_s,
                world.state.people,
                world.scene.clearance,
                world.stepping_aside,
            )

    def finish(self) -> list[Encounter]:
        """Return all encounters, those under way too."""
        self._part(set())
        return self.over

    def _part(self, present: set[str]) -> None:
        for name in self._under_way.keys() - present:
            self.over.append(self._under_way.pop(name))

    def _is_in_view(self, robot: Pose, person: Pose, clearance: ClearanceMap) -> bool:
        gap = relative(robot, person)
        half_width_rad = math.asin(min(1.0, PERSON_RADIUS_M / max(float(np.hypot(gap[0], gap[1])), PERSON_RADIUS_M)))
        bearing = abs(math.atan2(float(gap[1]), float(gap[0])))
        if bearing > self._spec.camera.horizontal_fov_rad / 2 + half_width_rad:
            return False
        return bool(clearance.along(robot[None, :2], person[None, :2])[0] > 0)
