"""ROS's tree of frames: which frame hangs on which, where it is there, and how it moves.

Owns the tree and no message: `/tf`, `/tf_static` and odometry all come in as (parent, child, pose).
"""

from collections.abc import Iterator

import numpy as np

from ltvn_core.importing.moving_frame import MovingFrame, Transform, inverse

_DEEPEST = 64
"""Robots have a dozen frames between the ground and a camera; more is a circle."""
_SAID_OFTEN = 3
"""Poses of a frame that moves, while another was said once and for all."""
_MOST_FRAMES = 10_000
"""So many frames has no robot; further ones are not taken in."""


class TransformTree:
    """Frames by name. A frame hangs on the parent that was last named for it."""

    def __init__(self) -> None:
        """Begin without any frame."""
        self._parents: dict[str, str] = {}
        self._fixed: dict[str, Transform] = {}
        self._moving: dict[str, MovingFrame] = {}
        self._settled: set[str] = set()
        """Frames that are fixed because they were said once, as long as nobody says otherwise."""

    def add_fixed(self, parent: str, child: str, pose: Transform) -> None:
        """Hang a frame onto another for good."""
        if parent != child and child not in self._moving and len(self._parents) < _MOST_FRAMES:
            self._parents[child] = parent
            self._fixed[child] = pose

    def add_moving(self, parent: str, child: str, stamp: float, pose: Transform) -> None:
        """Say where a frame is in another at a moment."""
        if parent == child or len(self._parents) >= _MOST_FRAMES:
            return
        if child in self._settled and self._parents[child] == parent and np.allclose(self._fixed[child], pose):
            return
        self._settled.discard(child)
        if (held := self._fixed.pop(child, None)) is not None and self._parents[child] not in self._parents:
            # What the frame hung on hangs on it from now on: `base_link` below a `base_footprint` that moves.
            self._fixed[self._parents[child]] = inverse(held)
            self._parents[self._parents[child]] = child
        if self._parents.get(child) != parent:
            self._parents[child] = parent
            self._moving[child] = MovingFrame()
        self._moving.setdefault(child, MovingFrame()).add(stamp, pose)

    def settle(self) -> None:
        """Fix the frames of which one pose was said while others were said again and again.

        In Foxglove's files a pose holds until the next one; in ROS's it is of its moment.
        """
        if any(moving.count >= _SAID_OFTEN for moving in self._moving.values()):
            for child in [child for child, moving in self._moving.items() if moving.count == 1]:
                self._fixed[child] = self._moving.pop(child).last
                self._settled.add(child)

    @property
    def frames(self) -> set[str]:
        """Names of all frames."""
        return {*self._parents, *self._parents.values()}

    def ancestors(self, frame: str) -> Iterator[str]:
        """Yield the frames that a frame hangs on, itself first."""
        for _ in range(_DEEPEST):
            yield frame
            if frame not in self._parents:
                return
            frame = self._parents[frame]

    def forget_motion(self) -> None:
        """Forget where frames were, and keep on what they hang."""
        self._moving = {child: MovingFrame() for child in self._moving}

    @property
    def motions(self) -> list[tuple[str, str]]:
        """(parent, child) of all frames that move in their parent."""
        return [(self._parents[child], child) for child in self._moving]

    def newest_s(self, target: str, source: str) -> float:
        """Return up to which moment it is known where `source` was in `target`, which it hangs on."""
        newest = float("inf")
        for frame in self.ancestors(source):
            if frame == target:
                return newest
            if frame in self._moving:
                newest = min(newest, self._moving[frame].newest_s)
        return float("-inf")

    def lookup(self, target: str, source: str, stamp: float) -> Transform | None:
        """Return where `source` was in `target` at a moment; None where the tree does not tell."""
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
