"""The people who walk through a world: who comes, who leaves, and where they are.

Time is the robot's: while it stands still, so do people.
"""

from collections.abc import Sequence

import numpy as np

from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.simulation.changes.walking_person import ROOM_M, WalkingPerson
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Pose
from ltvn_core.worlds.world_change import PersonMoved

AWAKE_S = (7.5 * HOUR_S, 22.5 * HOUR_S)
"""People are there between these times of the day."""
_APPEAR_M = 2.0
"""A person comes into the world at least this far from the robot."""


class People:
    """All people who walk through one world."""

    def __init__(self, count: int, seed: int) -> None:
        """Expect `count` people by day."""
        self._names = tuple(f"person-{number}" for number in range(count))
        self._rng = np.random.default_rng((seed, 17))
        self._walking: list[WalkingPerson] = []

    def among(self, present: Sequence[PersonMoved]) -> tuple[PersonMoved, ...]:
        """Return who is there now, by name; of those `present` before, only whoever walks by no script stays."""
        others = [each for each in present if each.person not in self._names]
        return tuple(sorted((*others, *(each.moved for each in self._walking)), key=lambda each: each.person))

    @property
    def stepping_aside(self) -> tuple[str, ...]:
        """Who makes room for the robot at this moment."""
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
        """Send those away who stand near a pose (3,); they come in anew elsewhere."""
        self._walking = [each for each in self._walking if np.hypot(*(each.pose - pose)[:2]) >= _APPEAR_M / 2]

    def scatter(self) -> None:
        """Forget where everybody is, after time in which nobody watched; all come in anew."""
        self._walking = []

    def walk(self, duration_s: float, clearance: ClearanceMap, robot: Sequence[float] | None) -> None:
        """Let everybody walk on for a moment; `robot` is x, y and radius in metres."""
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
