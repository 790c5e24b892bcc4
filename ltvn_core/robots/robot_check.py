"""Plausibility checks of the sequence of a robot's observations.

Owns the rules and their limits. An observation that is invalid by itself is rejected earlier
(`ltvn_core.preprocessing`); the findings here are only reported, because a person may know better.
"""

import zlib
from collections.abc import Iterable, Iterator

import numpy as np

from ltvn_core.findings import Finding
from ltvn_core.types import Observation, Pose

JUMP_M = 50.0
"""Distance between two consecutive images that counts as a jump, in metres. It is larger than the simulated buildings,
because the simulator may move its robot anywhere between two queries."""
SAME_STAMPS = 5
"""Number of consecutive images with the same stamp that means a stopped clock; two occur when a simulated robot is
moved."""
ALIKE_IMAGES = 20
"""Number of consecutive images with equal pixels that is suspicious, because a working camera has noise, and a
simulated camera moves."""
ALIKE_TRAVEL_M = 1.0
"""Least distance driven during equal images, in metres, because the images of a robot that stands still may be
equal."""


class ObservationCheck:
    """Checks the observations of one robot or one recording."""

    def __init__(self) -> None:
        """Start without an observation."""
        self._last: Observation | None = None
        self._told: set[str] = set()
        self._same_stamps = 1
        self._checksum = 0
        self._alike = 1
        self._alike_since: Pose = np.zeros(3)

    def findings(self, observation: Observation) -> list[Finding]:
        """Return what is doubtful about the next observation; each rule is reported only at its first violation."""
        before, now = self._last, observation
        self._last = now
        if before is None:
            self._begin_alike(now)
            return []
        is_same_step = (now.step, now.stamp) == (before.step, before.stamp)
        if now is before or (is_same_step and np.array_equal(now.odometry, before.odometry)):
            return []  # A robot may return an observation twice within a control step.
        fresh = [(rule, finding) for rule, finding in self._doubts(before, now) if rule not in self._told]
        self._told.update(rule for rule, _ in fresh)
        return [finding for _, finding in fresh]

    def _doubts(self, before: Observation, now: Observation) -> Iterator[tuple[str, Finding]]:
        """Yield the violated rules, each by name with what to tell the user."""
        if now.step == before.step:
            text = f"Step {now.step} appeared twice; only its first image is kept. Give each image a higher step."
            yield "repeated step", Finding(text)
        elif now.step < before.step:
            text = f"Step {now.step} follows step {before.step}; steps must increase, even after a restart."
            yield "backward step", Finding(text)
        if now.stamp < before.stamp:
            text = f"At step {now.step} the clock jumps back from {before.stamp:.3f} s to {now.stamp:.3f} s."
            yield "backward stamp", Finding(text, remedy="Use one clock that never jumps back.")
        self._same_stamps = self._same_stamps + 1 if now.stamp == before.stamp else 1
        if self._same_stamps >= SAME_STAMPS:
            text = f"The last {SAME_STAMPS} images up to step {now.step} have the stamp {now.stamp:.3f} s."
            yield "standing clock", Finding(f"{text} Has the robot's clock stopped?")
        moved_m = float(np.hypot(*(now.odometry - before.odometry)[:2]))
        if moved_m > JUMP_M:
            text = f"Odometry jumps by {moved_m:,.0f} m at step {now.step}; is it in metres, and does it restart?"
            yield "jump", Finding(text)
        if _checksum(now) != self._checksum:
            self._begin_alike(now)
            return
        self._alike += 1
        driven_m = float(np.hypot(*(now.odometry - self._alike_since)[:2]))
        if self._alike >= ALIKE_IMAGES and driven_m >= ALIKE_TRAVEL_M:
            text = f"The last {self._alike} images up to step {now.step} are equal, although the robot drove"
            yield "alike", Finding(f"{text} {driven_m:.1f} m; has the camera stopped, or is it covered?")

    def _begin_alike(self, observation: Observation) -> None:
        self._checksum = _checksum(observation)
        self._alike = 1
        self._alike_since = observation.odometry


def sequence_findings(observations: Iterable[Observation]) -> tuple[Finding, ...]:
    """Return what is doubtful about a whole drive, in the order of its images."""
    check = ObservationCheck()
    return tuple(finding for observation in observations for finding in check.findings(observation))


def _checksum(observation: Observation) -> int:
    return zlib.crc32(np.ascontiguousarray(observation.rgb).data)
