"""Reads one episode of a LeRobotDataset (version 2 or 3): images, depth if there is any, and the robot's pose."""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from ltvn_core.cameras.encoded_images import decode_colour, decode_depth
from ltvn_core.data.importing.foreign_files import read_bytes_within
from ltvn_core.data.importing.lerobot.dataset import INFO, Feature, LerobotDataset
from ltvn_core.data.importing.lerobot.layouts import Episode
from ltvn_core.data.importing.raw_frame import NOTHING, DriveFacts, RawFrame, ReadOptions, SourceFact
from ltvn_core.data.importing.source_camera import camera_beside, fitted
from ltvn_core.errors import DriveError
from ltvn_core.extras import naming_the_extra
from ltvn_core.types import Depth, Pose, Rgb

_X = re.compile(r"(^|[._/])x(_m|\.pos|_pos)?$", re.IGNORECASE)
_Y = re.compile(r"(^|[._/])y(_m|\.pos|_pos)?$", re.IGNORECASE)
_YAW = re.compile(r"(^|[._/])(yaw|theta|heading)(_rad|\.pos|_pos)?$", re.IGNORECASE)

DAMAGED = "damaged image"
OTHER_EPISODE = "of another episode"


class LerobotReader:
    """An episode that is open for reading."""

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        """Read the description of the data set and choose its longest episode. Raises DriveError."""
        self._dataset = LerobotDataset(folder)
        self._camera = options.camera or camera_beside(folder).camera
        self._rgb = self._image_feature(options.rgb, "--rgb", is_depth=False)
        has_depth = any(each.is_image and each.is_depth for each in self._dataset.features.values())
        wants_depth = options.depth != NOTHING and (options.depth is not None or has_depth)
        self._depth = self._image_feature(options.depth, "--depth", is_depth=True) if wants_depth else None
        if self._depth is not None and options.depth_unit_m is not None:
            self._depth = replace(self._depth, metres_per_unit=options.depth_unit_m)
        self._state, self._columns = self._pose_feature(options.odometry)
        self.dropped: Counter[str] = Counter()
        self.doubts: list[str] = []
        episodes = self._dataset.episodes
        self._episode = max(episodes, key=lambda episode: (episode.length, -episode.number))
        if len(episodes) > 1:
            self.dropped[OTHER_EPISODE] = sum(episode.length for episode in episodes) - self._episode.length
            self.doubts.append(f"Of {len(episodes)} episodes the longest was read, number {self._episode.number}.")
        rate = self._dataset.fps
        used = (("rgb", self._rgb), ("depth", self._depth), ("odometry", self._state))
        self.facts = DriveFacts(
            format="lerobot",
            frames=self._episode.length,
            streams=[SourceFact(role, each.key, self._episode.length, rate) for role, each in used if each is not None],
            place=folder.resolve().name,
        )

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder with a data set; never raises."""
        try:
            return (path / INFO).is_file()
        except OSError:
            return False

    @classmethod
    def open(cls, path: Path, options: ReadOptions) -> Self:
        """Open a data set. Raises DriveError, and MissingLibraryError if the library for its videos is missing."""
        return cls(path, options)

    def frames(self) -> Iterator[RawFrame]:
        """Yield the frames of the episode. Raises DriveError where none can be read."""
        read = 0
        last = -math.inf
        columns = ["timestamp", *(each.key for each in (self._rgb, self._depth) if each and each.dtype == "image")]
        columns += [] if self._state is None else [self._state.key]
        rgb, depth = (
            _Video(self._dataset, self._episode, each) if each is not None and each.dtype == "video" else None
            for each in (self._rgb, self._depth)
        )
        for row in self._dataset.rows(self._episode, columns):
            stamp = row["timestamp"]
            if not isinstance(stamp, int | float) or not last < stamp < math.inf:
                self.dropped["not later than the image before"] += 1
                continue
            try:
                frame = self._frame(float(stamp), row, rgb, depth)
            except DriveError as error:
                if not self.dropped[DAMAGED]:
                    self.doubts.append(f"An image was left out: {error}")
                self.dropped[DAMAGED] += 1
                continue
            last = float(stamp)
            read += 1
            yield frame
        if not read:
            raise DriveError(
                f"{self._dataset.folder}: no image of {self._rgb.key} can be read. {' '.join(self.doubts)}"
            )

    def _frame(self, stamp: float, row: Mapping[str, Any], rgb: "_Video | None", depth: "_Video | None") -> RawFrame:
        name = f"{self._rgb.key} at {stamp:.3f}"
        image = decode_colour(self._blob(row, self._rgb), name) if rgb is None else rgb.colours(stamp)
        height, width = image.shape[:2]
        depth_m = None if depth is None else depth.metres(stamp)
        if depth is None and self._depth is not None:
            blob, unit_m = self._blob(row, self._depth), self._depth.metres_per_unit
            depth_m = decode_depth(blob, unit_m, f"{self._depth.key} at {stamp:.3f}")
        return RawFrame(
            stamp=stamp,
            rgb=image,
            depth_m=depth_m,
            camera=None if self._camera is None else fitted(self._camera, width, height, name),
            odometry=self._pose(row),
            name=name,
        )

    def _blob(self, row: Mapping[str, Any], feature: Feature) -> bytes:
        """Return a compressed image, from the row or from a file that the row names."""
        cell = row[feature.key]
        blob, path = (cell.get("bytes"), cell.get("path")) if isinstance(cell, dict) else (cell, None)
        if isinstance(blob, bytes):
            return blob
        if not isinstance(path, str):
            raise DriveError(f"{feature.key} holds no image.")
        folder = f"images/{feature.key}/episode_{self._episode.number:06d}"
        beside = f"{folder}/{Path(path).name}"
        return read_bytes_within(self._dataset.folder, beside if (self._dataset.folder / beside).is_file() else path)

    def _pose(self, row: Mapping[str, Any]) -> Pose | None:
        if self._state is None:
            return None
        numbers = row[self._state.key]
        try:
            pose = np.array([numbers[place] for place in self._columns], np.float64)
        except (TypeError, ValueError, IndexError):  # The table may lack columns that the description names.
            return None
        return pose if np.isfinite(pose).all() else None

    def _image_feature(self, asked: str | None, option: str, *, is_depth: bool) -> Feature:
        images = [each for each in self._dataset.features.values() if each.is_image]
        if asked is not None:
            found = [each for each in images if each.key == asked or each.key.endswith(f".{asked}")]
        else:
            found = [each for each in images if each.is_depth == is_depth]
            found = [each for each in found if each.key.rpartition(".")[2] in ("front", "head", "ego")] or found
        if len(found) != 1:
            names = ", ".join(each.key for each in images) or "none"
            raise DriveError(f"{self._dataset.folder}: choose images with {option}; the data set has {names}.")
        return found[0]

    def _pose_feature(self, asked: str | None) -> tuple[Feature | None, Sequence[int]]:
        """Return the column with the robot's pose, and the indices of x, y and yaw in it."""
        if asked == NOTHING:
            return None, ()
        for each in self._dataset.features.values():
            if each.is_image or (asked is not None and each.key != asked) or each.key == "action":
                continue
            places = [
                next((n for n, name in enumerate(each.names) if kind.search(name)), None) for kind in (_X, _Y, _YAW)
            ]
            found = [place for place in places if place is not None]
            if len(found) == len(places):
                return each, found
        if asked is not None:
            raise DriveError(f"{self._dataset.folder}: {asked} has no numbers called x, y and yaw.")
        return None, ()


class _Video:
    """The images of one video of an episode, requested in the order of their stamps."""

    def __init__(self, dataset: LerobotDataset, episode: Episode, feature: Feature) -> None:
        with naming_the_extra():
            from ltvn_core.data.importing import video_frames
        self._decoding = video_frames
        self._feature = feature
        self._period_s = 1 / dataset.fps
        begin, end = dataset.layout.video_span(feature.key, episode)
        self._part = video_frames.VideoPart(dataset.video(feature.key, episode), begin, end)
        self._images = video_frames.video_images(self._part, self._period_s)
        self._current: Any = None

    def colours(self, stamp: float) -> Rgb:
        return self._decoding.colours(self._at(stamp))

    def metres(self, stamp: float) -> Depth:
        frame = self._at(stamp)
        codes = self._decoding.codes(frame, self._part.path)
        if frame.format.name == "gray16le":  # Not quantised: exactly what the sensor measured.
            return codes.astype(np.float32) * np.float32(self._feature.metres_per_unit)
        return self._feature.codes.metres(codes)

    def _at(self, stamp: float) -> Any:
        """Return the image of a moment. Raises DriveError where the video has none."""
        while self._current is None or self._current.stamp < stamp - self._period_s / 2:
            self._current = next(self._images, None)
            if self._current is None:
                raise DriveError(f"{self._part.path} ends before {stamp:.3f} s.")
        if self._current.stamp > stamp + self._period_s / 2:
            raise DriveError(f"{self._part.path} has no image at {stamp:.3f} s.")
        return self._current.frame
