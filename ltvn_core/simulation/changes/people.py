"""People who walk through a world: their arrivals, departures and paths.

A person walks from place to place, stands there for a while, and waits if the robot or another person is too close
ahead; nobody walks into the robot. After waiting in vain, a person takes another path, and steps aside if the robot
comes closer and there is room. People move only while the robot's clock advances.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Pose
from ltvn_core.worlds import PersonMoved

AWAKE_S = (7.5 * HOUR_S, 22.5 * HOUR_S)
"""Times of the day between which people are present, in seconds."""
_APPEAR_M = 2.0
"""Least distance from the robot at which a person appears, in metres."""
SPEEDS_M_S = (0.5, 0.9)
_KEEP_M = 0.3
"""Distance to other bodies at which a person stops, in metres."""
_ASIDE_M = 0.25
"""Distance of the robot at which a person steps aside, from surface to surface, in metres."""
_ASIDE_M_S = 0.8
"""Speed of a person who steps aside, in metres per second."""
_ASIDE_RAD = np.deg2rad((0.0, 45.0, -45.0, 90.0, -90.0))
"""Directions in which a person steps aside, relative to straight away from the robot; the first free one is taken."""
_BODY_M = 0.2
"""Clearance of the place to which a person steps aside, in metres."""
_PAUSE_S = (2.0, 20.0)
_PATIENCE_S = 4.0
"""Waiting time after which a person goes to another place, in seconds."""
_CHOICES, _LOOKS_AHEAD_M = 4, 1.2
"""Number of ways that a person tries, and the distance ahead that must be free of others, in metres."""
_TURN_RAD_S = 2.5
_AHEAD_M = 0.3
ROOM_M = 0.3
"""Clearance of the places where people stand, in metres."""


class People:
    """All people who walk through one world."""

    def __init__(self, count: int, seed: int) -> None:
        """Create `count` people, who are present by day."""
        self._names = tuple(f"person-{number}" for number in range(count))
        self._rng = np.random.default_rng((seed, 17))
        self._walking: list[WalkingPerson] = []

    def among(self, present: Sequence[PersonMoved]) -> tuple[PersonMoved, ...]:
        """Return all people who are present now, sorted by name; people in `present` who were placed by hand are
        kept."""
        others = [each for each in present if each.person not in self._names]
        return tuple(sorted((*others, *(each.moved for each in self._walking)), key=lambda each: each.person))

    @property
    def stepping_aside(self) -> tuple[str, ...]:
        """Names of the people who make room for the robot now."""
        return tuple(person.name for person in self._walking if person.steps_aside)

    def come_and_go(self, time_s: float, clearance: ClearanceMap, robot: Pose | None) -> None:
        """Let people come in the morning, and leave in the evening."""
        if not AWAKE_S[0] <= time_s % DAY_S < AWAKE_S[1]:
            self._walking = []
            return
        here = {person.name for person in self._walking}
        for name in self._names:
            if name not in here:
                self._arrive(name, clearance, robot)

    def send_away_from(self, pose: Pose) -> None:
        """Remove people near a pose (3,); they appear again at another place."""
        self._walking = [each for each in self._walking if np.hypot(*(each.pose - pose)[:2]) >= _APPEAR_M / 2]

    def scatter(self) -> None:
        """Forget all positions after unobserved time; all people appear again at new places."""
        self._walking = []

    def walk(self, duration_s: float, clearance: ClearanceMap, robot: Sequence[float] | None) -> None:
        """Let all people walk for a duration; `robot` is x, y and radius in metres."""
        for person in self._walking:
            others = [(*each.pose[:2], PERSON_RADIUS_M) for each in self._walking if each is not person]
            places = np.array(others, np.float64).reshape(-1, 3)
            person.walk(duration_s, clearance, places, None if robot is None else np.array(robot, np.float64))

    def _arrive(self, name: str, clearance: ClearanceMap, robot: Pose | None) -> None:
        places = clearance.sample_poses(self._rng, 16, min_clearance_m=ROOM_M)
        if robot is not None:
            places = places[np.hypot(*(places[:, :2] - robot[:2]).T) > _APPEAR_M]
        if len(places):
            clothes = int(self._rng.integers(1, 2**31))
            self._walking.append(WalkingPerson(name, clothes, places[0], np.random.default_rng(clothes)))


class WalkingPerson:
    """One person in a world."""

    def __init__(self, name: str, seed: int, pose: Pose, rng: np.random.Generator) -> None:
        """Start at a pose (3,), in clothes drawn with a seed."""
        self.name = name
        self.seed = seed
        self.pose: Pose = pose
        self._rng = rng
        self._speed_m_s = float(rng.uniform(*SPEEDS_M_S))
        self._way: NDArray[np.float64] = np.empty((0, 2))
        self._pause_s = float(rng.uniform(0, _PAUSE_S[1]))
        self._waited_s = 0.0
        self._robot_m = np.inf
        self.steps_aside = False
        """Whether the person makes room for the robot now."""

    @property
    def moved(self) -> PersonMoved:
        """The person's current pose, as a change of the world."""
        x, y, yaw = self.pose.tolist()
        return PersonMoved(self.name, (x, y, yaw), self.seed)

    def walk(
        self, duration_s: float, clearance: ClearanceMap, others: NDArray[np.float64], robot: NDArray[np.float64] | None
    ) -> None:
        """Walk for a duration.

        Args:
            duration_s: Duration in seconds.
            clearance: Current obstacles.
            others: (N, 3) x, y and radius in metres of the other people.
            robot: (3,) x, y and radius in metres of the robot; None without one.
        """
        if robot is not None:
            if self._make_room(duration_s, clearance, others, robot):
                return
            others = np.vstack([others, robot])
        if self._pause_s > 0:
            self._pause_s -= duration_s
            return
        if not len(self._way):
            self._choose_way(clearance, others)
            return
        step = self._step(duration_s)
        if clearance.at(step[:2]) <= 0 or self._is_too_near(step[:2], others):
            self._waited_s += duration_s
            if self._waited_s > _PATIENCE_S:
                self._way = np.empty((0, 2))
            return
        self._waited_s = 0.0
        self.pose = step
        passed = np.hypot(*(self._way - step[:2]).T) < _AHEAD_M
        if passed.any():
            self._way = self._way[int(np.flatnonzero(passed)[-1]) + 1 :]
        if not len(self._way):
            self._pause_s = float(self._rng.uniform(*_PAUSE_S))

    def _make_room(
        self, duration_s: float, clearance: ClearanceMap, others: NDArray[np.float64], robot: NDArray[np.float64]
    ) -> bool:
        """Step aside if the robot is near and comes closer; return whether the person did."""
        gap = self.pose[:2] - robot[:2]
        before_m, self._robot_m = self._robot_m, float(np.hypot(*gap)) - robot[2] - PERSON_RADIUS_M
        self.steps_aside = self._robot_m < min(_ASIDE_M, before_m - 1e-3)
        if not self.steps_aside:
            return False
        away = np.arctan2(gap[1], gap[0]) + _ASIDE_RAD
        places = self.pose[:2] + _ASIDE_M_S * duration_s * np.stack([np.cos(away), np.sin(away)], axis=-1)
        free = clearance.at(places) > min(_BODY_M, float(clearance.at(self.pose[:2])))
        free &= [not self._is_too_near(place, others) for place in places]
        if free.any():
            self.pose = np.array([*places[int(free.argmax())], self.pose[2]])
            self._robot_m = float(np.hypot(*(self.pose[:2] - robot[:2]))) - robot[2] - PERSON_RADIUS_M
            self._way = np.empty((0, 2))
        return True

    def _choose_way(self, clearance: ClearanceMap, others: NDArray[np.float64]) -> None:
        """Choose a goal, if possible one whose path is not blocked by other people close ahead."""
        self._waited_s = 0.0
        for goal in clearance.sample_poses(self._rng, _CHOICES, min_clearance_m=ROOM_M):
            way = clearance.path(self.pose[:2], goal[:2])
            if way is None:
                continue
            self._way = way[1:]
            soon = self._way[np.hypot(*(self._way - self.pose[:2]).T) < _LOOKS_AHEAD_M]
            if not any(self._is_too_near(place, others) for place in soon):
                return
        if not len(self._way):
            self._pause_s = 1.0

    def _step(self, duration_s: float) -> Pose:
        """Return the person's next pose (3,); a person who must turn first turns on the spot."""
        x, y, yaw = self.pose
        gap = self._way[0] - self.pose[:2]
        turn = float(np.angle(np.exp(1j * (np.arctan2(gap[1], gap[0]) - yaw))))
        yaw += float(np.clip(turn, -_TURN_RAD_S * duration_s, _TURN_RAD_S * duration_s))
        length_m = 0.0 if abs(turn) > 1 else min(self._speed_m_s * duration_s, float(np.hypot(*gap)))
        direction = gap / max(float(np.hypot(*gap)), 1e-6)
        return np.array([x + length_m * direction[0], y + length_m * direction[1], yaw])

    def _is_too_near(self, place: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
        """Tell whether a place is too close to another body, and closer to that body than the person is now."""
        if not len(others):
            return False
        then_m = np.hypot(*(others[:, :2] - place).T)
        now_m = np.hypot(*(others[:, :2] - self.pose[:2]).T)
        return bool(((then_m < others[:, 2] + PERSON_RADIUS_M + _KEEP_M) & (then_m < now_m)).any())
