"""Images and features of nodes and reserve by frame, each encoded once, and which images a map can be built from.

Owns the observations and features of every frame that is a node or in the reserve, and their order in time. Features
lie in growing arrays, in memory while they are small, then in temporary files. Does not decide which frames to keep:
the caller drops those that left the map.
"""

import logging
import tempfile
import weakref
from bisect import bisect_left, bisect_right, insort
from collections.abc import Collection, Iterable, Sequence
from itertools import count
from typing import IO

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import MapError
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.corrections import Correction, UnsurePlaces
from ltvn_core.robots.robot_spec import NeededSpace
from ltvn_core.types import Features, FrameId, HeldFeatures, Observation, Pose, Predictor, is_usable

log = logging.getLogger(__name__)

MOST_IN_MEMORY = 2**27
"""Size in bytes above which the rows are memory-mapped from a file, so that only the pages in use need memory. An image
takes 23 kB."""
_FIRST_ROWS = 64
_STAMPS = count(1)  # One for each feature row ever stored, in any map.


class FeatureRows:
    """An array with room for M rows."""

    def __init__(self, like: Features) -> None:
        """Start with rows of the shape and dtype of `like` (F,)."""
        self.array: Features = np.empty((_FIRST_ROWS, *like.shape), like.dtype)
        """All rows (M, F), read-only; rows that were not written yet are undefined."""
        self._file: IO[bytes] | None = None

    def put(self, place: int, row: Features) -> None:
        """Write one row (F,). Raises OSError if the disk is full."""
        while place >= len(self.array):
            self._grow()
        if self._file is None:
            self.array[place] = row
            return
        # Written to the file and not through the memory map, because there a full disk would kill the process.
        self._file.seek(place * row.nbytes)
        self._file.write(row.tobytes())
        self._file.flush()

    def _grow(self) -> None:
        """Double the capacity, so that the total cost of growing is linear."""
        if self.array.dtype.hasobject or 2 * self.array.nbytes <= MOST_IN_MEMORY:
            self.array = np.concatenate([self.array, np.empty_like(self.array)])
            return
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the rows)
            weakref.finalize(self, self._file.close)
            self._file.write(self.array.tobytes())
        self._file.truncate(2 * self.array.nbytes)
        shape = (2 * len(self.array), *self.array.shape[1:])
        self.array = np.asarray(np.memmap(self._file, self.array.dtype, "r", shape=shape))


ODOMETRY_JUMP = 1.5
"""Distance d by odometry between consecutive frames above which a new stretch of driving begins."""


class KeyframeStore:
    """Images with their features in growing arrays; rows of dropped frames are used again."""

    def __init__(self, predictor: Predictor) -> None:
        """Start empty; `predictor` encodes the images that are added."""
        self._predictor = predictor
        self._observations: dict[FrameId, Observation] = {}
        self._rows: dict[FrameId, int] = {}
        self._order: list[FrameId] = []
        self._free: list[int] = []
        self.drive_starts: tuple[FrameId, ...] = ()
        """The first frame of each drive, in order; empty for a single drive."""
        self.resumed_starts: tuple[FrameId, ...] = ()
        """The first frames of drives that continue the odometry of the drive before, in order."""
        self._features: FeatureRows | None = None
        self._keys: FeatureRows | None = None
        self._stamps = FeatureRows(np.array(0))
        self._asked: tuple[tuple[FrameId, ...], NDArray[np.intp]] | None = None
        """The frames of the last call of `held`, and their rows; None after a change."""
        self.corrections: list[Correction] = []
        """What building a map from these images corrected or added by itself, in order."""
        self.unsure: UnsurePlaces | None = None
        self.space: NeededSpace | None = None
        """Space that the robot of these images needs free; None if the robot is unknown."""
        self._has_odometry = False
        """Whether odometry ever moved; if not, it cannot tell which images are near each other."""

    def __contains__(self, frame: FrameId) -> bool:
        return frame in self._rows

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def frames(self) -> Sequence[FrameId]:
        """All frames in the order they were taken."""
        return tuple(self._order)

    @property
    def odometry_starts(self) -> tuple[FrameId, ...]:
        """The first frame of each drive whose odometry restarts, in order; empty for a single drive."""
        return tuple(frame for frame in self.drive_starts if frame not in self.resumed_starts)

    def needed_space(self, camera: CameraModel) -> NeededSpace:
        """Return the space that the robot needs free; an assumed one if the robot behind this camera is unknown."""
        return self.space or NeededSpace.assumed(camera)

    def begin_drives(self, frames: Iterable[FrameId], *, resumed: Iterable[FrameId] = ()) -> None:
        """Begin another drive at each of some frames; images before and after such a frame are not neighbours in time.

        Args:
            frames: First frames of drives.
            resumed: Those of `frames` whose drive continues the odometry of the drive before; `maps.joined_drives`
                decides which.
        """
        self.drive_starts = tuple(sorted({*self.drive_starts, *frames}))
        self.resumed_starts = tuple(sorted({*self.resumed_starts, *resumed}))

    def restart_odometry(self, frame: FrameId) -> None:
        """Mark that odometry restarts at the first frame of a drive."""
        self.resumed_starts = tuple(other for other in self.resumed_starts if other != frame)

    def drive_of(self, frame: FrameId) -> int:
        """Return the number of the drive that a frame belongs to."""
        return bisect_right(self.drive_starts, frame)

    def add(self, observations: Sequence[Observation], features: Features | None = None) -> None:
        """Add images; new ones are encoded in one batch unless their features (N, F) are given."""
        fresh = [k for k, seen in enumerate(observations) if seen.step not in self._rows]
        if not fresh:
            return
        new = [observations[k] for k in fresh]
        encoded = self._predictor.encode(new) if features is None else features[fresh]
        place_keys = getattr(self._predictor, "place_keys", None)
        keys = None if place_keys is None else place_keys(encoded)
        for k, seen in enumerate(new):
            self._store(seen, encoded[k], None if keys is None else keys[k])

    def correct(self, observations: Iterable[Observation]) -> None:
        """Replace the observations of frames; only their odometry may differ. Raises MapError if a frame is not
        stored."""
        for seen in observations:
            self.observation(seen.step)
            self._observations[seen.step] = seen

    def drop(self, frames: Iterable[FrameId]) -> None:
        """Forget images; unknown ones are ignored."""
        for frame in frames:
            if frame in self._rows:
                self._asked = None
                self._free.append(self._rows.pop(frame))
                del self._observations[frame]
                del self._order[bisect_left(self._order, frame)]

    def keep_only(self, frames: Iterable[FrameId]) -> None:
        """Forget every image but these."""
        self.drop(set(self._rows) - set(frames))

    def observation(self, frame: FrameId) -> Observation:
        """Return the image; raise MapError if it is not stored."""
        try:
            return self._observations[frame]
        except KeyError:
            raise MapError(f"The image of frame {frame} is missing; a map must contain all its images.") from None

    def features(self, frames: Sequence[FrameId]) -> Features:
        """Return (N, F) features; raise MapError if one is not stored."""
        missing = [frame for frame in frames if frame not in self._rows]
        if self._features is None or missing:
            raise MapError(f"The images of frames {missing[:5]} are missing; a map must contain all its images.")
        return self._features.array[[self._rows[frame] for frame in frames]]

    def held(self, frames: tuple[FrameId, ...]) -> HeldFeatures | None:
        """Return the rows of the features of N frames; None if one is not stored or the predictor makes no keys."""
        if self._features is None or self._keys is None:
            return None
        if self._asked is None or self._asked[0] is not frames:
            rows = np.array([self._rows.get(frame, -1) for frame in frames], np.intp)
            if rows.min(initial=0) < 0:
                return None
            self._asked = frames, rows
        return HeldFeatures(self._features.array, self._keys.array, self._asked[1], self._stamps.array.view(np.int64))

    def temporal_neighbours(self, frame: FrameId, gap: float) -> tuple[FrameId, ...]:
        """Return the frames just before and after, if odometry puts them within d < gap."""
        if not self._has_odometry:
            return ()
        here = bisect_left(self._order, frame)
        beside = [self._order[k] for k in (here - 1, here + 1) if 0 <= k < len(self._order)]
        odometry = self.observation(frame).odometry
        beside = [other for other in beside if self.drive_of(other) == self.drive_of(frame)]
        near = [distance(relative(odometry, self._observations[other].odometry)) < gap for other in beside]
        return tuple(other for other, is_near in zip(beside, near, strict=True) if is_near)

    def temporal_window(self, frame: FrameId, reach: int) -> tuple[FrameId, ...]:
        """Return up to `reach` frames before and after a frame, without itself, up to where odometry jumps."""
        here = bisect_left(self._order, frame)
        before = self._unbroken(self._order[max(here - reach, 0) : here + 1][::-1])
        return (*before[:0:-1], *self._unbroken(self._order[here : here + 1 + reach])[1:])

    def _unbroken(self, frames: Sequence[FrameId]) -> Sequence[FrameId]:
        """Return the frames up to the first jump between two of them."""
        if not self._has_odometry:
            return frames[:1]
        odometry = np.array([self._observations[frame].odometry for frame in frames])
        jumps = np.flatnonzero(distance(relative(odometry[:-1], odometry[1:])) > ODOMETRY_JUMP)
        frames = frames[: jumps[0] + 1] if len(jumps) else frames
        return [frame for frame in frames if self.drive_of(frame) == self.drive_of(frames[0])]

    def _store(self, seen: Observation, row: Features, key: Features | None) -> None:
        place = self._free.pop() if self._free else len(self._rows)
        self._features = self._features or FeatureRows(row)
        self._features.put(place, row)
        self._stamps.put(place, np.array(next(_STAMPS)))
        if key is not None:
            self._keys = self._keys or FeatureRows(key)
            self._keys.put(place, key)
        self._asked = None
        if not self._has_odometry and self._observations:
            first = next(iter(self._observations.values()))
            self._has_odometry = not np.array_equal(first.odometry, seen.odometry)
        self._rows[seen.step] = place
        self._observations[seen.step] = seen
        insort(self._order, seen.step)


def usable_trajectory(
    observations: Sequence[Observation], predictor: Predictor, goals: Collection[FrameId] = ()
) -> Sequence[Observation]:
    """Return the images of a trajectory that a predictor can compare, and log how many it cannot.

    Raises:
        MapError: The trajectory is empty, frame numbers repeat, or goals are not frames; or no image has the depth that
            the predictor needs, or a goal has none.
    """
    if not observations:
        raise MapError("The trajectory is empty; drive and record some images before building a map.")
    frames = [seen.step for seen in observations]
    if len(set(frames)) != len(frames):
        raise MapError("Frame numbers repeat in the trajectory; each image needs its own.")
    if unknown := set(goals) - set(frames):
        raise MapError(f"The goal frames {sorted(unknown)[:5]} are not in the trajectory.")
    usable = [seen for seen in observations if is_usable(seen, predictor)]
    if len(usable) == len(observations):
        return observations
    left_out = [seen.step for seen in observations if not is_usable(seen, predictor)]
    if not usable:
        raise MapError(
            f"None of the {len(observations)} images has depth, and the predictor needs it. Is the depth camera "
            "running? Drive again with it, or use a predictor that needs no depth."
        )
    if blind := sorted(set(goals) & set(left_out)):
        raise MapError(f"The goal frames {blind[:5]} have no depth, which the predictor needs; choose other goals.")
    log.warning(
        "%d of %d images have no depth (the first is frame %d); the map is built without them.",
        len(left_out),
        len(observations),
        left_out[0],
    )
    return usable


def odometry_of(observations: Sequence[Observation]) -> Pose:
    """Return the odometry (N, 3) of images."""
    return np.array([seen.odometry for seen in observations]).reshape(-1, 3)
