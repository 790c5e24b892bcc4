"""Watches a robot's observations, one after the other, for what cannot be right of a robot that drives.

Owns the rules and their limits. What is wrong with one observation alone is refused at the door
(`ltvn_core.preprocessing`); here it is told and kept, because a person may know better.
"""

import zlib
from collections.abc import Iterable, Iterator
from enum import Enum, auto

import numpy as np

from ltvn_core.types import Observation, Pose

JUMP_M = 50.0
"""Two images in a row are never so far apart. Larger than the buildings of the simulator, because it may put its robot
anywhere between two queries; what a robot drives between two images is less than a metre."""
SAME_STAMPS = 5
"""So many images in a row at one time mean a clock that stands still; a simulated robot that is put elsewhere has 2."""
ALIKE_IMAGES = 20
"""So many images in a row that are equal in every pixel; a camera that works has noise, and a simulated one moves."""
ALIKE_TRAVEL_M = 1.0
"""And the robot drove so far meanwhile, for whoever stands still may well see the same."""


class _Doubt(Enum):
    """A rule; each speaks once."""

    REPEATED_STEP = auto()
    BACKWARD_STEP = auto()
    BACKWARD_STAMP = auto()
    STANDING_CLOCK = auto()
    JUMP = auto()
    ALIKE = auto()


class ObservationCheck:
    """The check of one robot or of one recording."""

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self._last: Observation | None = None
        self._told: set[_Doubt] = set()
        self._same_stamps = 1
        self._checksum = 0
        self._alike = 1
        self._alike_since: Pose = np.zeros(3)

    def doubts(self, observation: Observation) -> list[str]:
        """Return what is doubtful of the next observation, in words; each rule speaks at its first breach alone."""
        before, self._last = self._last, observation
        if before is None:
            self._begin_alike(observation)
            return []
        if _is_same(before, observation):
            return []
        found = [*self._order(before, observation), *self._motion(before, observation), *self._pictures(observation)]
        fresh = [(rule, text) for rule, text in found if rule not in self._told]
        self._told.update(rule for rule, _ in fresh)
        return [text for _, text in fresh]

    def _order(self, before: Observation, now: Observation) -> Iterator[tuple[_Doubt, str]]:
        if now.step == before.step:
            yield _Doubt.REPEATED_STEP, f"Step {now.step} came twice, and only its first image can be kept; count on."
        elif now.step < before.step:
            text = f"Step {now.step} comes after step {before.step}; steps count on, also where a robot starts anew."
            yield _Doubt.BACKWARD_STEP, text
        if now.stamp < before.stamp:
            text = f"At step {now.step} the clock goes back from {before.stamp:.3f} s to {now.stamp:.3f} s."
            yield _Doubt.BACKWARD_STAMP, f"{text} Use one clock that only goes on."
        self._same_stamps = self._same_stamps + 1 if now.stamp == before.stamp else 1
        if self._same_stamps >= SAME_STAMPS:
            text = f"The last {SAME_STAMPS} images up to step {now.step} have the stamp {now.stamp:.3f} s."
            yield _Doubt.STANDING_CLOCK, f"{text} Does the robot's clock stand still?"

    def _motion(self, before: Observation, now: Observation) -> Iterator[tuple[_Doubt, str]]:
        moved_m = float(np.hypot(*(now.odometry - before.odometry)[:2]))
        if moved_m > JUMP_M:
            text = f"Odometry jumps by {moved_m:,.0f} m at step {now.step}; is it in metres, and does it restart?"
            yield _Doubt.JUMP, text

    def _pictures(self, now: Observation) -> Iterator[tuple[_Doubt, str]]:
        if _checksum(now) != self._checksum:
            self._begin_alike(now)
            return
        self._alike += 1
        driven_m = float(np.hypot(*(now.odometry - self._alike_since)[:2]))
        if self._alike >= ALIKE_IMAGES and driven_m >= ALIKE_TRAVEL_M:
            text = f"The last {self._alike} images up to step {now.step} are equal, though the robot drove"
            yield _Doubt.ALIKE, f"{text} {driven_m:.1f} m; does the camera stand still, or is it covered?"

    def _begin_alike(self, observation: Observation) -> None:
        self._checksum, self._alike, self._alike_since = _checksum(observation), 1, observation.odometry


def sequence_doubts(observations: Iterable[Observation]) -> tuple[str, ...]:
    """Return what is doubtful of a whole drive, in the order in which it was taken."""
    check = ObservationCheck()
    return tuple(text for observation in observations for text in check.doubts(observation))


def _is_same(before: Observation, now: Observation) -> bool:
    """Tell whether a robot handed out the same observation again, as it may within a control step."""
    return now is before or (
        now.step == before.step and now.stamp == before.stamp and np.array_equal(now.odometry, before.odometry)
    )


def _checksum(observation: Observation) -> int:
    return zlib.crc32(np.ascontiguousarray(observation.rgb).data)
