"""Compares the odometry of a drive with its images: sense of turning, standstill, and clocks.

Owns the rules and their limits. A doubt needs many pairs of images that agree with each other: without texture or
motion there is none.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.importing.image_motion import View, image_motion
from ltvn_core.findings import Finding
from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Observation, Pose

_APART_M = 0.08
_APART_RAD = np.radians(3.0)
"""Distance in metres, or turn, after which two images are compared."""
_STANDING = 1e-9
"""Largest change of a pose, in metres and radians, that counts as none at all."""
_STANDING_S = 0.2
"""Time in seconds after which images of a standing robot are compared."""
_LEAST_STRETCH_S = 1.0
_MOVED_SHIFT = 0.02
_SAME_SHIFT = 0.003
"""Median shift of the key points, as a share of the image's width, above which the camera has surely moved, and below
which it has surely not."""
_LEAST_TIMES = 3
"""Least number of pairs, and least time `_LEAST_STRETCH_S` in seconds, in which images must have moved while odometry
stood, or the reverse."""
_TURNING_RAD = np.radians(2.0)
_SEEN_TURNING_RAD = np.radians(1.0)
"""Least turn of a pair by odometry, and by the images, for its sense to count."""
_ARM_M = 0.5
_ASIDE_M = 0.03
"""Largest motion aside of a pair, in metres a radian of its turn, and in metres; who circles around a thing sees it
turn the other way."""
_LEAST_TURNS = 8
_OPPOSITE_SHARE = 0.8
_LEAST_PAIRS = 15
_LONGEST_SHIFT_S = 5.0
_SHIFT_STEP_S = 0.1
_LEAST_SHIFT_S = 0.3
"""Least offset of two clocks in seconds that is reported; a robot turns by ten degrees in that time."""
_BETTER = 0.25
"""Largest error after shifting the odometry in time, as a share of the error without, for the shift to be true."""
_LARGEST_ERROR_RAD = np.radians(10.0)
_FITTING_RAD = np.radians(3.0)
"""Error of a turn that counts at most, and root mean square error below which odometry fits the images."""


class _Pair(NamedTuple):
    begin: float
    end: float
    turn: float
    """By odometry, in radians."""
    seen: float | None
    """By the images, in radians; None if it is unknown."""


class _Stretch(NamedTuple):
    begin: float
    end: float
    times: int
    """Number of pairs in which images and odometry contradicted each other."""

    @property
    def is_clear(self) -> bool:
        """Whether the contradiction lasted long enough to be told."""
        return self.times >= _LEAST_TIMES and self.end - self.begin >= _LEAST_STRETCH_S


class OdometryComparison:
    """Compares the images of one drive with its odometry, while the drive is imported."""

    def __init__(self) -> None:
        """Start before the first image."""
        self._last: View | None = None
        self._before: Pose | None = None
        self._is_still = False
        self._pairs: list[_Pair] = []
        self._moments: list[tuple[float, float]] = []
        self._frozen: list[_Stretch] = []
        self._same: list[_Stretch] = []

    def needs(self, stamp: float, pose: Pose) -> bool:
        """Tell whether the image of a moment is needed although the robot stands; called for each image in order."""
        if np.isfinite(pose).all():  # The check of the frame rejects other poses.
            self._moments.append((stamp, float(pose[2])))
        self._is_still = self._before is not None and _stands(self._before, pose)
        self._before = pose
        last = self._last
        return last is not None and self._is_still and self._is_due(last, stamp, pose)

    def add(self, seen: Observation, camera: CameraModel) -> None:
        """Take an image of the recorded `camera`; images too near the one before are ignored."""
        last = self._last
        if last is not None and not self._is_due(last, seen.stamp, seen.odometry):
            return
        view = View.of(seen, camera)
        if last is None or self._compare(last, view):
            self._last = view

    def findings(self) -> Iterator[Finding]:
        """Yield what does not fit, after the last image."""
        is_mirrored = self._is_mirrored()
        if is_mirrored:
            yield Finding(
                "Images and odometry turn in opposite ways: when the images turn left, the poses turn right. A map "
                "would be mirrored.",
                remedy="If the odometry has y to the right and z down (NED, FRD), record it with y to the left and z "
                "up, or name its frames so (odom_ned, base_link_frd). If the images are mirrored or upside down, turn "
                "them.",
            )
        shift_s = None if is_mirrored else self._shift_s()
        if shift_s is None:
            yield from self._standstills()
            return
        side = "late" if shift_s > 0 else "early"
        yield Finding(
            f"Odometry fits the images best if it is stamped {abs(shift_s):.1f} s too {side}, so the poses are wrong "
            "by the way driven in that time.",
            remedy="Synchronise the clocks of all machines before you record.",
        )

    def _standstills(self) -> Iterator[Finding]:
        frozen = [each for each in self._frozen if each.is_clear]
        if frozen:
            yield Finding(
                f"Odometry stood exactly still {self._when(frozen)} while the images moved, so it was lost or frozen; "
                "the images of that time were left out as too little motion, or have a wrong pose.",
                remedy="Record again with odometry that goes on, or omit it with --odometry none.",
            )
        same = [each for each in self._same if each.is_clear]
        if same:
            yield Finding(
                f"The images stood still {self._when(same)} while odometry turned, so they are not of the same moments "
                "or of the same robot.",
                remedy="Was the camera's picture frozen, or were the wheels spinning?",
            )

    def _when(self, stretches: list[_Stretch]) -> str:
        begin = self._moments[0][0]
        said = [f"from {each.begin - begin:.1f} s to {each.end - begin:.1f} s" for each in stretches[:3]]
        more = f" and {len(stretches) - 3} more times" if len(stretches) > 3 else ""
        return f"{', '.join(said)}{more} of the drive"

    def _is_due(self, last: View, stamp: float, pose: Pose) -> bool:
        """Tell whether an image is far enough from the last one, in time or by its pose, to be compared with it."""
        if _stands(last.pose, pose):
            return stamp - last.stamp >= _STANDING_S
        gap = pose - last.pose
        return self._is_still or bool(np.hypot(*gap[:2]) >= _APART_M or abs(wrap_angle(gap[2])) >= _APART_RAD)

    def _compare(self, last: View, view: View) -> bool:
        """Compare two views; return whether the later one replaces the other."""
        if _stands(last.pose, view.pose):
            motion = image_motion(last, view)
            if motion is None or not motion.is_one_scene:
                return True
            if motion.shift >= _MOVED_SHIFT:
                _extend(self._frozen, last.stamp, view.stamp)
            # A slow motion adds up, while the view before stays the one to compare with.
            return motion.shift >= _MOVED_SHIFT
        turn = float(wrap_angle(view.pose[2] - last.pose[2]))
        # The motion across the heading halfway between both poses, to the left.
        heading = last.pose[2] + turn / 2
        gap = view.pose - last.pose
        aside_m = float(np.cos(heading) * gap[1] - np.sin(heading) * gap[0])
        if abs(aside_m) <= _ASIDE_M + _ARM_M * abs(turn):
            motion = image_motion(last, view)
            self._pairs.append(_Pair(last.stamp, view.stamp, turn, None if motion is None else motion.turn_rad))
            if abs(turn) >= 2 * _TURNING_RAD and motion is not None and motion.shift <= _SAME_SHIFT:
                _extend(self._same, last.stamp, view.stamp)
        return True

    def _is_mirrored(self) -> bool:
        turns = np.array([(pair.turn, pair.seen) for pair in self._pairs if pair.seen is not None]).reshape(-1, 2)
        turns = turns[(np.abs(turns) >= (_TURNING_RAD, _SEEN_TURNING_RAD)).all(axis=1)]
        return len(turns) >= _LEAST_TURNS and float((turns.prod(axis=1) < 0).mean()) >= _OPPOSITE_SHARE

    def _shift_s(self) -> float | None:
        """Return by how many seconds odometry is late; None if it fits best as it is, or nothing shows it."""
        known = np.array([(pair.begin, pair.end, pair.seen) for pair in self._pairs if pair.seen is not None])
        if len(known) < _LEAST_PAIRS:
            return None
        stamps, yaws = np.array(self._moments).T
        yaws = np.unwrap(yaws)
        shifts = np.arange(-_LONGEST_SHIFT_S, _LONGEST_SHIFT_S + _SHIFT_STEP_S / 2, _SHIFT_STEP_S)
        errors = np.array([_error(known, stamps, yaws, shift) for shift in shifts])
        best = int(np.argmin(errors))
        unshifted = errors[len(shifts) // 2]
        is_better = errors[best] < min(_BETTER * unshifted, _FITTING_RAD**2)
        return float(shifts[best]) if is_better and abs(shifts[best]) >= _LEAST_SHIFT_S else None


def _stands(before: Pose, now: Pose) -> bool:
    return bool(np.abs(now - before).max() <= _STANDING)


def _extend(stretches: list[_Stretch], begin: float, end: float) -> None:
    """Add a pair of images to the last stretch if it follows directly, otherwise begin a new stretch."""
    if stretches and begin <= stretches[-1].end:
        stretches[-1] = _Stretch(stretches[-1].begin, end, stretches[-1].times + 1)
    else:
        stretches.append(_Stretch(begin, end, 1))


def _error(pairs: NDArray[np.float64], stamps: NDArray[np.float64], yaws: NDArray[np.float64], shift: float) -> float:
    """Return the mean square error of the turns of pairs (N, 3: begin, end, seen turn) by odometry that is late by
    `shift` seconds; infinity if most pairs are outside of the odometry."""
    begin, end, seen = pairs.T
    inside = (begin + shift >= stamps[0]) & (end + shift <= stamps[-1])
    if inside.sum() < max(_LEAST_PAIRS, len(pairs) / 2):
        return float("inf")
    turns = np.interp(end[inside] + shift, stamps, yaws) - np.interp(begin[inside] + shift, stamps, yaws)
    return float(np.mean(np.minimum(np.abs(turns - seen[inside]), _LARGEST_ERROR_RAD) ** 2))
