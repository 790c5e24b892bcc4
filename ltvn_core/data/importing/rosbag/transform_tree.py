"""ROS's transform tree: the parent of each frame, the pose in its parent, and the motion of this pose.

Owns the tree, and the limits for interpolating between two poses of a frame. Independent of message types: `/tf`,
`/tf_static` and odometry all arrive as (parent, child, pose).
"""

from bisect import bisect_right
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.spatial_pose import Transform, inverse, pose_between

_LONGEST_GAP_S = 0.5
"""Longest gap between two poses that is interpolated, in seconds, unless the robot stood still in between."""
_STANDING_M = 0.03
_STANDING_RAD = np.radians(2.0)
"""Rotation in radians, and movement `_STANDING_M` in metres, below which a robot stood still."""
_LATEST_S = 0.1
"""Longest time in seconds for which the first pose holds before its stamp, and the last pose after it."""
_KEPT = 4096
"""Number of poses that are kept; older ones are not needed, because images wait for their poses."""
_DEEPEST = 64
"""Largest depth of the tree; robots have a dozen frames between ground and camera, so a deeper tree is a cycle."""
_SAID_OFTEN = 3
"""Least number of poses in the survey that make a frame a moving one; frames with a single pose are then fixed."""
_MOST_FRAMES = 10_000
"""Largest number of frames; further ones are ignored."""


class MovingFrame:
    """Poses of a frame in its parent, in the order of their stamps; poses that arrive late are left out."""

    def __init__(self) -> None:
        """Begin without any pose."""
        self._stamps: list[float] = []
        self._poses: list[Transform] = []

    @property
    def newest_s(self) -> float:
        """Stamp of the last pose; minus infinity without any."""
        return self._stamps[-1] if self._stamps else float("-inf")

    @property
    def count(self) -> int:
        """Number of known poses."""
        return len(self._stamps)

    @property
    def first_s(self) -> float:
        """Stamp of the first known pose; minus infinity without any."""
        return self._stamps[0] if self._stamps else float("-inf")

    @property
    def is_still(self) -> bool:
        """Whether there are poses, and all known ones are equal."""
        return bool(self._poses) and np.allclose(self._poses, self._poses[-1])

    @property
    def last(self) -> Transform:
        """Last pose; there must be one."""
        return self._poses[-1]

    def add(self, stamp: float, pose: Transform) -> bool:
        """Add a pose; return False if it is not newer than the last one, and is therefore left out."""
        if stamp <= self.newest_s:
            return False
        self._stamps.append(stamp)
        self._poses.append(pose)
        if len(self._stamps) > 2 * _KEPT:
            del self._stamps[:_KEPT], self._poses[:_KEPT]
        return True

    def at(self, stamp: float) -> Transform | None:
        """Return the pose at a time; None if the known poses are too far from it."""
        after = bisect_right(self._stamps, stamp)
        if 0 < after < len(self._stamps):
            return self._between(after, stamp)
        if not self._stamps:
            return None
        nearest = -1 if after else 0
        return self._poses[nearest] if abs(self._stamps[nearest] - stamp) <= _LATEST_S else None

    def _between(self, after: int, stamp: float) -> Transform | None:
        begin = self._stamps[after - 1]
        end = self._stamps[after]
        first = self._poses[after - 1]
        second = self._poses[after]
        turn = Rotation.from_matrix([first[:3, :3], second[:3, :3]])
        if end - begin > _LONGEST_GAP_S and not _stands(first, second, turn):
            return None
        places = np.array([first[:3, 3], second[:3, 3]])
        return pose_between(places, turn, (stamp - begin) / (end - begin))


def _stands(first: Transform, second: Transform, turn: Rotation) -> bool:
    moved = float(np.linalg.norm(second[:3, 3] - first[:3, 3]))
    return moved < _STANDING_M and float((turn[0].inv() * turn[1]).magnitude()) < _STANDING_RAD


class TransformTree:
    """Frames by name. The parent of a frame is the one that was named last."""

    def __init__(self) -> None:
        """Begin without any frame."""
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, Transform] = {}
        self._moving: dict[str, MovingFrame] = {}
        self._settled: set[str] = set()
        """Frames that count as fixed because only one pose was published for each; a different pose makes them
        moving."""

    def add_fixed(self, parent: str, child: str, pose: Transform) -> None:
        """Set the fixed pose of a frame in its parent."""
        if parent != child and child not in self._moving and len(self._parents) < _MOST_FRAMES:
            self._parents[child] = parent
            self._fixed[child] = pose

    def add_moving(self, parent: str, child: str, stamp: float, pose: Transform) -> None:
        """Add the pose of a frame in its parent at a time."""
        if parent == child or len(self._parents) >= _MOST_FRAMES:
            return
        if child in self._settled and self._parents[child] == parent and np.allclose(self._fixed[child], pose):
            return
        self._settled.discard(child)
        if (held := self._fixed.pop(child, None)) is not None and self._parents[child] not in self._parents:
            # The former parent becomes a child, such as `base_link` below a moving `base_footprint`.
            self._fixed[self._parents[child]] = inverse(held)
            self._parents[self._parents[child]] = child
        if self._parents.get(child) != parent:
            self._parents[child] = parent
            self._moving[child] = MovingFrame()
        self._moving.setdefault(child, MovingFrame()).add(stamp, pose)

    def settle(self) -> None:
        """Make frames with a single pose fixed if another frame has several poses.

        In Foxglove's files a pose holds until the next one; in ROS's files only at its stamp.
        """
        if any(moving.count >= _SAID_OFTEN for moving in self._moving.values()):
            for child in [child for child, moving in self._moving.items() if moving.count == 1]:
                self._fixed[child] = self._moving.pop(child).last
                self._settled.add(child)

    def settle_still(self, camera_frame: str, robot: str) -> None:
        """Make the frames from the camera up to the robot fixed that never moved; old drivers repeat them on `/tf`."""
        for child in self.ancestors(camera_frame):
            if child == robot:
                return
            if child in self._moving and self._moving[child].is_still:
                self._fixed[child] = self._moving.pop(child).last
                self._settled.add(child)

    def first_s(self, frame: str) -> float:
        """Return the time from which the poses of a frame and its ancestors in the survey are known."""
        return max(
            (self._moving[each].first_s for each in self.ancestors(frame) if each in self._moving),
            default=float("-inf"),
        )

    @property
    def frames(self) -> set[str]:
        """Names of all frames."""
        return {*self._parents, *self._parents.values()}

    def ancestors(self, frame: str) -> Iterator[str]:
        """Yield a frame and all its ancestors, upwards."""
        for _ in range(_DEEPEST):
            yield frame
            if frame not in self._parents:
                return
            frame = self._parents[frame]

    def forget_motion(self) -> None:
        """Forget the poses of moving frames, but keep their parents."""
        self._moving = {child: MovingFrame() for child in self._moving}

    @property
    def motions(self) -> list[tuple[str, str]]:
        """(parent, child) of all frames that move in their parent."""
        return [(self._parents[child], child) for child in self._moving]

    def newest_s(self, target: str, source: str) -> float:
        """Return the latest time at which the pose of `source` in its ancestor `target` is known."""
        newest = float("inf")
        for frame in self.ancestors(source):
            if frame == target:
                return newest
            if frame in self._moving:
                newest = min(newest, self._moving[frame].newest_s)
        return float("-inf")

    def lookup(self, target: str, source: str, stamp: float) -> Transform | None:
        """Return the pose of `source` in `target` at a time; None if the tree does not contain it."""
        way = list(self.ancestors(source))
        other = list(self.ancestors(target))
        shared = next((frame for frame in way if frame in other), None)
        if shared is None:
            return None
        rise = self._rise(way[: way.index(shared)], stamp)
        fall = self._rise(other[: other.index(shared)], stamp)
        return None if rise is None or fall is None else inverse(fall) @ rise

    def _rise(self, frames: list[str], stamp: float) -> Transform | None:
        pose = np.eye(4)
        for frame in frames:
            step = self._moving[frame].at(stamp) if frame in self._moving else self._fixed[frame]
            if step is None:
                return None
            pose = step @ pose
        return pose
