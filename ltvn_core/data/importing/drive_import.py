"""Imports a drive: raw frames are checked, selected, prepared and written as a recording, with a summary.

Owns the order of these steps, the count of left-out images, and the selection. A map needs images that differ, so an
image is kept when the robot has moved far enough, according to its odometry or, without odometry, to the images.
Independent of the format.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from itertools import chain, islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.atomic_files import atomic_output
from ltvn_core.data.importing.drive_statistics import (
    NO_ODOMETRY,
    NO_TRUTH,
    STAMP_NOT_AFTER,
    TOO_LITTLE_MOTION,
    DriveStatistics,
)
from ltvn_core.data.importing.frame_preparation import FramePreparation
from ltvn_core.data.importing.import_options import (
    ImportOptions,
    OdometrySource,
    chosen_odometry,
    frames_with_odometry,
    has_odometry,
)
from ltvn_core.data.importing.import_summary import ImportSummary, import_summary, unread_text
from ltvn_core.data.importing.odometry_comparison import OdometryComparison
from ltvn_core.data.importing.pose_outages import PoseOutages
from ltvn_core.data.importing.raw_frame import DriveReader, FrameMoment, RawFrame, SelectiveReader
from ltvn_core.data.recording.metadata import SOURCE_SCENE
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import DriveError, ImageError
from ltvn_core.findings import Finding, findings_of
from ltvn_core.geometry import wrap_angle
from ltvn_core.navigation.events import Note, StampedEvent
from ltvn_core.robots.robot_check import ObservationCheck
from ltvn_core.types import Observation, Pose, Rgb, Tilt

MOVED_SHARE = 0.04
"""Median shift of the tracked points above which an image is kept, as a share of the image's width."""
LOST_SHARE = 0.5
"""Share of the tracked points that must be lost for an image to be kept."""
_WIDTH_PX = 160
_POINTS = 120
_FEWEST_POINTS = 8
_ROUNDING = 1e-4
"""Tolerance for rounded poses of a source, in metres and radians, so that images 0.1 m apart are kept at a spacing of
0.1 m."""
_NOISE = 2.0
"""Mean difference of two images, in grey levels of 255, below which they count as equal."""
_DECIDING_FRAMES = 100
"""Number of kept images from whose median the camera's usual tilt is computed; they are written only after that."""
Progress = Callable[[int, int | None], None]
"""Callback with the number of images processed, and the number of all images if it is known."""


class FrameSelection:
    """Decides for each image in turn whether the camera has moved enough since the last kept one.

    By its pose it has after a minimum distance, or a minimum change of heading, pitch or roll; by its picture, for
    drives without any odometry, when the content has changed enough.
    """

    def __init__(self, every_m: float, every_rad: float, *, by_picture: bool) -> None:
        """Take the spacing; every image is kept if both limits are 0."""
        self._every_m = every_m
        self._every_rad = every_rad
        self.is_by_picture = by_picture and bool(every_m or every_rad)
        self._last: NDArray[np.float64] | None = None
        self._last_grey: NDArray[np.uint8] | None = None

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether an image with this pose and tilt could be kept; called before the image is decoded."""
        if self._last is None or self.is_by_picture:
            return True
        gap = _pose_and_tilt(pose, tilt) - self._last
        moved_m = np.hypot(*gap[:2])
        turned_rad = np.abs(wrap_angle(gap[2:])).max()
        # A pose with NaN is kept here; the later check of the frame rejects it and gives the reason.
        return not (moved_m < self._every_m - _ROUNDING and turned_rad < self._every_rad - _ROUNDING)

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether to keep an image, which the next ones are then compared with."""
        if not self.may_keep(pose, tilt):
            return False
        if self.is_by_picture:
            height = max(round(_WIDTH_PX * rgb.shape[0] / rgb.shape[1]), 1)
            small = cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
            before, grey = self._last_grey, np.asarray(small, np.uint8)
            if before is not None and before.shape == grey.shape and not _has_moved(before, grey):
                return False
            self._last_grey = grey
        self._last = _pose_and_tilt(pose, tilt)
        return True


def _pose_and_tilt(pose: Pose, tilt: Tilt | None) -> NDArray[np.float64]:
    return np.array([*pose, *(tilt or (0.0, 0.0))])


def _has_moved(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> bool:
    if float(cv2.absdiff(before, now).mean()) < _NOISE:
        return False
    points = cv2.goodFeaturesToTrack(before, _POINTS, 0.01, 5)
    if points is None or len(points) < _FEWEST_POINTS:
        return True
    found, status, _ = cv2.calcOpticalFlowPyrLK(before, now, points, None)  # type: ignore[call-overload]
    followed = status.ravel() == 1
    if followed.mean() < 1 - LOST_SHARE:
        return True
    moved_px = np.linalg.norm((found - points)[followed].reshape(-1, 2), axis=1)
    return float(np.median(moved_px)) >= MOVED_SHARE * _WIDTH_PX


def import_drive(
    reader: DriveReader,
    output: Path | str,
    options: ImportOptions = ImportOptions(),  # noqa: B008
    progress: Progress = lambda _done, _total: None,
) -> ImportSummary:
    """Write a drive to a new recording, which appears only when it is complete.

    Raises DriveError where nothing of the drive can be used, RecordingError where `output` exists or cannot be written.
    """
    output = Path(output)
    with atomic_output(output) as part:
        return _DriveImport(reader, options, progress).write(part, output)


class _DriveImport:
    """One import, from the first raw frame to the summary."""

    def __init__(self, reader: DriveReader, options: ImportOptions, progress: Progress) -> None:
        self._reader = reader
        self._options = options
        self._progress = progress
        self._choose(OdometrySource.AUTO)  # Until the first frames are seen.
        self._statistics: DriveStatistics | None = None
        self._dropped: Counter[str] = Counter()
        self._faults: list[str] = []
        self._comparison = OdometryComparison()
        self._stamps: list[float] = []

    def write(self, path: Path, name: Path) -> ImportSummary:
        """Write the whole drive to `path`, and return the summary, in which the file has the name `name`."""
        reader, options = self._reader, self._options
        observations = self._observations()
        first = list(islice(observations, _DECIDING_FRAMES))
        found = self._statistics
        if not first or found is None:
            raise DriveError(self._nothing_left())
        # Height and pitch of the mounting are from the user's options, else pitch is the median of the images.
        camera = found.preparation.camera
        pitch_rad = camera.pitch_rad if found.usual_pitch_rad is None else found.usual_pitch_rad
        camera = replace(
            camera,
            height_m=camera.height_m if options.height_m is None else options.height_m,
            pitch_rad=pitch_rad if options.pitch_deg is None else float(np.radians(options.pitch_deg)),
        )
        asked = {name: value for name, value in asdict(options).items() if value is not None}
        said = {**asked, "odometry": str(self._odometry), "is_lens_known": found.preparation.is_lens_known}
        if self._odometry is OdometrySource.SOURCE and reader.facts.odometry_frame:
            said["odometry_frame"] = reader.facts.odometry_frame
        config = {"verb": "import", "format": reader.facts.format, "import": said}
        scene = options.scene or f"{SOURCE_SCENE}{reader.facts.place or reader.facts.format}"
        check = ObservationCheck()
        of_sequence: list[Finding] = []
        seen = first[0]
        with RecordingWriter(path, scene=scene, config=config, fingerprint="", camera=camera) as writer:
            for seen in chain(first, observations):
                writer.write_frame(seen)
                of_sequence += check.findings(seen)
            found.dropped = self._all_dropped()
            found.is_spacing_ignored = self._selection.is_by_picture and options.has_own_spacing
            faults = [f"An image was left out: {fault}" for fault in self._faults[:1]]
            if self._odometry is OdometrySource.NONE is not options.odometry and found.has_odometry:
                faults.append(
                    "Odometry was not used, because the first images have none; cut the drive where it begins."
                )
            told = findings_of([*reader.doubts, *self._outages.sentences(), *faults])
            summary = import_summary(
                found,
                recording=name,
                scene=scene,
                camera=camera,
                told=(*told, *of_sequence, *self._comparison.findings()),
            )
            for finding in summary.findings:
                writer.write_event(StampedEvent(seen.step, seen.stamp, Note(str(finding), finding.severity)))
        return summary

    def _observations(self) -> Iterator[Observation]:
        """Yield the kept images, and count all others; a `SelectiveReader` decodes only those that may be kept."""
        reader = self._reader
        if isinstance(reader, SelectiveReader) and has_odometry(reader, self._options.odometry):
            frames = reader.frames_where(self._is_wanted_of_selective)
        else:
            odometry, all_frames = frames_with_odometry(reader, self._options.odometry)
            self._choose(odometry)
            frames = (raw for raw in all_frames if self._is_wanted(FrameMoment.of(raw)))
        for raw in frames:
            try:
                observation = self._observation(raw)
            except ImageError as error:
                self._faults.append(str(error))
                self._dropped["image, depth or pose that cannot be"] += 1
                continue
            if observation is not None:
                yield observation

    def _is_wanted_of_selective(self, moment: FrameMoment) -> bool:
        if not self._stamps:
            self._choose(chosen_odometry(self._reader, [moment], self._options.odometry))
        return self._is_wanted(moment)

    def _choose(self, odometry: OdometrySource) -> None:
        options = self._options
        by_picture = odometry is OdometrySource.NONE
        self._odometry = odometry
        self._selection = FrameSelection(options.every_m, float(np.radians(options.every_deg)), by_picture=by_picture)
        self._outages = PoseOutages("the true pose" if odometry is OdometrySource.TRUTH else "odometry")

    def _is_wanted(self, moment: FrameMoment) -> bool:
        """Tell whether the image of a moment may be kept; if not, count the reason."""
        self._progress(len(self._stamps) + sum(self._reader.dropped.values()) + 1, self._reader.facts.frames)
        before = self._stamps[-1] if self._stamps else -np.inf
        self._stamps.append(max(moment.stamp, before))
        if not moment.stamp > before:
            self._dropped[STAMP_NOT_AFTER] += 1
            return False
        pose = self._odometry.pose(moment)
        self._outages.add_image(moment.stamp, has_pose=pose is not None)
        if pose is None:
            self._dropped[NO_TRUTH if self._odometry is OdometrySource.TRUTH else NO_ODOMETRY] += 1
            return False
        is_needed = self._comparison.needs(moment.stamp, pose) or self._selection.may_keep(pose, moment.tilt)
        if not is_needed:
            self._dropped[TOO_LITTLE_MOTION] += 1
        return is_needed

    def _observation(self, raw: RawFrame) -> Observation | None:
        """Return the observation of a frame that may be kept; if it is left out, count the reason and return None."""
        pose = self._odometry.pose(FrameMoment.of(raw))
        assert pose is not None  # `_is_wanted` has checked this.
        is_compared = self._odometry is not OdometrySource.NONE
        is_kept = self._selection.keeps(raw.rgb, pose, raw.tilt)
        observation = None
        if is_kept or is_compared:
            if self._statistics is None:
                facts = self._reader.facts
                unread, _ = unread_text(facts, "camera_info", "")
                preparation = FramePreparation(raw, fov_deg=self._options.fov_deg, unread=unread)
                self._statistics = DriveStatistics(
                    facts=facts, odometry=self._odometry, preparation=preparation, stamps=self._stamps
                )
            preparation = self._statistics.preparation
            observation = preparation.observation(raw, step=self._statistics.frames, odometry=pose)
            if is_compared:
                self._comparison.add(observation, preparation.camera)
            if is_kept:
                self._statistics.observe(observation, raw)
                return observation
        self._dropped[TOO_LITTLE_MOTION] += 1
        return None

    def _all_dropped(self) -> dict[str, int]:
        return dict(Counter(self._reader.dropped) + self._dropped)

    def _nothing_left(self) -> str:
        streams = ", ".join(f"{each.role or 'unused'} {each.name}" for each in self._reader.facts.streams) or "nothing"
        reasons = ", ".join(f"{reason}: {count}" for reason, count in self._all_dropped().items())
        if not reasons:
            return f"The drive holds no images at all; what was found: {streams}."
        faults = "".join(f" {fault}" for fault in [*self._faults[:1], *self._reader.doubts])
        return f"None of the images can be used ({reasons}).{faults} What was found: {streams}."
