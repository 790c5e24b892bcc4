"""Encounters of the robot with people: how close they came, and whether an attentive driver would have avoided contact.

A person never walks into the robot, and steps aside if the robot comes too close and there is room
(`simulation.changes.people`). A contact is avoidable if the robot drove towards the person in one of two ways:
backwards, where the camera sees nothing, or forwards after the camera had an unobstructed view of the person, within
the last seconds and early enough to brake. A contact is not avoidable if the robot stands or drives away, or if the
person appears at the last moment. Reads exact poses; needs no navigation.
"""

import math
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from ltvn_core.evaluation.query_result import EncounterCounts
from ltvn_core.geometry import relative
from ltvn_core.robots.robot_spec import LOCOBOT, RobotSpec
from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Pose, Twist
from ltvn_core.worlds import PersonMoved

BEGINS_M, ENDS_M = 1.5, 2.0
"""Distances at which an encounter begins and ends, in metres; all distances here are from surface to surface."""
_ATTENTION_S = 3.0
"""Time for which a driver remembers a person who has left the view, in seconds."""
_LOOK_S = 0.1
"""Reaction time of a driver before the robot brakes, in seconds."""
_VIEWS = 40
_TOUCH_M = 0.003


@dataclass(slots=True)
class Encounter:
    """An encounter of the robot with one person, from approach to parting."""

    person: str
    closest_m: float
    """Least distance between the two surfaces, in metres."""
    touched: bool = False
    gave_way: bool = False
    """Whether the person had to step aside."""
    avoidable: bool = False
    """Whether an attentive driver would not have touched the person."""
    stood_s: float = 0.0
    """Time for which the robot stood still during the encounter, in seconds."""
    seen_s: deque[float] = field(default_factory=lambda: deque(maxlen=_VIEWS))
    """Last times at which the camera had the person in view, in seconds on the robot's clock."""

    def was_seen(self, first_s: float, last_s: float) -> bool:
        """Tell whether the camera had the person in view between two moments."""
        return any(first_s <= seen_s <= last_s for seen_s in self.seen_s)


def count_encounters(encounters: Sequence[Encounter]) -> EncounterCounts:
    """Return counts over several encounters."""
    return EncounterCounts(
        encounters=len(encounters),
        gave_way=sum(each.gave_way for each in encounters),
        touched=sum(each.touched for each in encounters),
        avoidable=sum(each.avoidable for each in encounters),
        closest_m=min((each.closest_m for each in encounters), default=None),
        closest_each_m=tuple(round(each.closest_m, 3) for each in encounters),
        stood_s=round(sum(each.stood_s for each in encounters), 1),
    )


class EncounterLog:
    """Records encounters from the poses of robot and people at each control step."""

    def __init__(self, spec: RobotSpec = LOCOBOT) -> None:
        """Start without encounters."""
        self._spec = spec
        self._under_way: dict[str, Encounter] = {}
        self._places: dict[str, Pose] = {}
        """Poses of people at the previous control step."""
        self.over: list[Encounter] = []
        """Encounters that have ended."""

    def take(
        self,
        stamp: float,
        robot: Pose,
        speeds: Twist,
        people: Sequence[PersonMoved],
        clearance: ClearanceMap,
        stepping_aside: Collection[str] = (),
    ) -> None:
        """Update the encounters with the poses of robot and people.

        Args:
            stamp: Seconds on the robot's clock.
            robot: Exact pose (3,) of the robot.
            speeds: Speeds at which the wheels drive and turn the robot.
            people: Poses of the people.
            clearance: Obstacles that may hide people.
            stepping_aside: People who make room for the robot, see `World.stepping_aside`.
        """
        for person in people:
            gap = self._gap(robot, person)
            away_m = float(np.hypot(gap[0], gap[1])) - self._spec.radius_m - PERSON_RADIUS_M
            encounter = self._under_way.get(person.person)
            if encounter is None:
                if away_m >= BEGINS_M:
                    continue
                encounter = self._under_way[person.person] = Encounter(person.person, away_m)
            encounter.closest_m = min(encounter.closest_m, away_m)
            if self._is_in_view(robot, np.array(person.pose), clearance):
                encounter.seen_s.append(stamp)
            if away_m <= _TOUCH_M and not encounter.touched:
                encounter.touched = True
                towards = bool(gap[0] * speeds.linear_m_s > 0)
                encounter.avoidable = towards and self._is_avoidable(stamp, speeds.linear_m_s, encounter)
            encounter.stood_s += CONTROL_STEP_S * (speeds == ZERO_TWIST)
            encounter.gave_way |= person.person in stepping_aside
            if away_m > ENDS_M:
                self.over.append(self._under_way.pop(person.person))
        self._part({each.person for each in people})
        self._places = {each.person: np.array(each.pose) for each in people}

    def watch(self, robot: SimulatedRobot) -> None:
        """Update the encounters of a robot with the people of its world."""
        world = robot.world
        if world is not None and world.state.people:
            self.take(
                robot.stamp,
                robot.exact_pose,
                robot.speeds,
                world.state.people,
                world.scene.clearance,
                world.stepping_aside,
            )

    def finish(self) -> list[Encounter]:
        """Return all encounters, including those that have not ended."""
        self._part(set())
        return self.over

    def _gap(self, robot: Pose, person: PersonMoved) -> Pose:
        """Return the nearer of a person's poses (3,) now and at the previous step, in the robot's frame.

        People step aside after the robot has moved, so a contact may already be over at the end of the step.
        """
        now = np.array(person.pose)
        gaps = relative(robot, np.array([now, self._places.get(person.person, now)]))
        return gaps[int(np.hypot(gaps[:, 0], gaps[:, 1]).argmin())]

    def _part(self, present: set[str]) -> None:
        for name in self._under_way.keys() - present:
            self.over.append(self._under_way.pop(name))

    def _is_avoidable(self, stamp: float, linear_m_s: float, encounter: Encounter) -> bool:
        """Tell whether an attentive driver would have braked before a contact at `stamp`."""
        if linear_m_s < 0:
            return True
        brake_s = _LOOK_S + linear_m_s / self._spec.accelerations.linear_braking_m_s2
        return encounter.was_seen(stamp - _ATTENTION_S, stamp - brake_s)

    def _is_in_view(self, robot: Pose, person: Pose, clearance: ClearanceMap) -> bool:
        gap = relative(robot, person)
        half_width_rad = math.asin(min(1.0, PERSON_RADIUS_M / max(float(np.hypot(gap[0], gap[1])), PERSON_RADIUS_M)))
        bearing = abs(math.atan2(float(gap[1]), float(gap[0])))
        if bearing > self._spec.camera.horizontal_fov_rad / 2 + half_width_rad:
            return False
        return bool(clearance.along(robot[None, :2], person[None, :2])[0] > 0)
