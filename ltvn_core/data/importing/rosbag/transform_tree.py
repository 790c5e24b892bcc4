"""ROS's transform tree: the parent of each frame, the pose in its parent, and the motion of this pose.

Owns the tree, and the limits for interpolating between two poses of a frame. Independent of message types: `/tf`,
`/tf_static` and odometry all arrive as (parent, child, pose).
"""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import takewhile

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
        self.stamps: list[float] = []
        self.poses: list[Transform] = []

    @property
    def newest_s(self) -> float:
        """Stamp of the last pose; minus infinity without any."""
        return self.stamps[-1] if self.stamps else float("-inf")

    def add(self, stamp: float, pose: Transform) -> bool:
        """Add a pose; return False if it is not newer than the last one, and is therefore left out."""
        if stamp <= self.newest_s:
            return False
        self.stamps.append(stamp)
        self.poses.append(pose)
        if len(self.stamps) > 2 * _KEPT:
            del self.stamps[:_KEPT], self.poses[:_KEPT]
        return True

    def at(self, stamp: float) -> Transform | None:
        """Return the pose at a time; None if the known poses are too far from it."""
        after = bisect_right(self.stamps, stamp)
        if 0 < after < len(self.stamps):
            return self._between(after, stamp)
        if not self.stamps:
            return None
        nearest = -1 if after else 0
        return self.poses[nearest] if abs(self.stamps[nearest] - stamp) <= _LATEST_S else None

    def _between(self, after: int, stamp: float) -> Transform | None:
        begin, end = self.stamps[after - 1 : after + 1]
        places = np.array([pose[:3, 3] for pose in self.poses[after - 1 : after + 1]])
        turns = Rotation.from_matrix([pose[:3, :3] for pose in self.poses[after - 1 : after + 1]])
        turned_rad = float((turns[0].inv() * turns[1]).magnitude())
        stands = float(np.linalg.norm(places[1] - places[0])) < _STANDING_M and turned_rad < _STANDING_RAD
        if end - begin > _LONGEST_GAP_S and not stands:
            return None
        return pose_between(places, turns, (stamp - begin) / (end - begin))


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
        if any(len(moving.poses) >= _SAID_OFTEN for moving in self._moving.values()):
            for child in [child for child, moving in self._moving.items() if len(moving.poses) == 1]:
                self._settle(child)

    def settle_still(self, camera_frame: str, robot: str) -> None:
        """Make the frames from the camera up to the robot fixed that never moved; old drivers repeat them on `/tf`."""
        for child in takewhile(lambda frame: frame != robot, self.ancestors(camera_frame)):
            known = self._moving[child].poses if child in self._moving else []
            if known and np.allclose(known, known[-1]):
                self._settle(child)

    def _settle(self, child: str) -> None:
        self._fixed[child] = self._moving.pop(child).poses[-1]
        self._settled.add(child)

    def first_s(self, frame: str) -> float:
        """Return the time from which the poses of a frame and its ancestors in the survey are known."""
        known = (self._moving[each].stamps[:1] for each in self.ancestors(frame) if each in self._moving)
        return max((stamp for stamps in known for stamp in stamps), default=float("-inf"))

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
